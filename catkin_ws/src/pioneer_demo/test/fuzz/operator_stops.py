"""Stops a robot through the fleet page about once a second, and measures how long each STOP takes.

Run it as ``operator_stops.py URL OPERATOR_TOKEN ROBOT PID`` until SIGINT, with the page's process ID. After each
STOP it writes a line of JSON: the number of STOPs, and for the slowest its times [s]: until the answer, which follows
the robot's zero command; that in which the page's threads ran, and waited for a processor, meanwhile; and the
machine's load. ``slowest itself`` is the slowest without the time in which the page's main thread waited for a
processor: what remains is the page's own doing.
"""

import contextlib
import http.client
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

from figures import tell
from websockets.sync.client import ClientConnection, connect

EVERY = 1.0
PATIENCE = 30.0
Times = dict[str, tuple[int, int]]


def scheduled(pid: int) -> Times:
    """Returns for each thread the time in which it ran, and waited for a processor [ns]."""
    found = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(OSError):
            ran, waited, _ = (task / "schedstat").read_text().split()
            found[f"{(task / 'comm').read_text().strip()} {task.name}"] = (int(ran), int(waited))
    return found


def since(before: Times, after: Times, name: str, what: int) -> float:
    """Returns how long a thread ran (0) or waited (1) between two moments [s]."""
    return (after.get(name, (0, 0))[what] - before.get(name, (0, 0))[what]) / 1e9


def most(before: Times, after: Times, what: int) -> dict[str, float]:
    """Returns the five threads that ran (0) or waited (1) longest between two moments, and all together [s]."""
    grown = {name: since(before, after, name, what) for name in after}
    first = sorted(grown, key=grown.__getitem__, reverse=True)[:5]
    return {"all": round(sum(grown.values()), 3), **{name: round(grown[name], 3) for name in first}}


def asked(live: ClientConnection, do: str, robot: str) -> float:
    """Sends a command; returns the time until its answer [s]."""
    began = time.monotonic()
    live.send(json.dumps({"do": do, "robots": [robot]}))
    while not isinstance(frame := live.recv(PATIENCE), str):
        pass
    answer = json.loads(frame)["answer"]
    assert answer["good"], answer
    return time.monotonic() - began


def login(url: str, token: str) -> str:
    """Returns the cookie of an operator's session."""
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=60)
    with contextlib.closing(connection):
        connection.request("POST", "/login", token)
        return str(connection.getresponse().headers["Set-Cookie"]).partition(";")[0]


def main() -> None:
    """Runs until SIGINT."""
    url, token, robot, pid = sys.argv[1:]
    end = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: end.set())
    slowest, itself, times = {"seconds": 0.0}, {"seconds": 0.0}, []
    main_thread = next(name for name in scheduled(int(pid)) if name.endswith(f" {pid}"))
    headers = {"Cookie": login(url, token)}
    address = url.replace("http", "ws") + "/live"
    with connect(address, additional_headers=headers, max_size=None, open_timeout=60) as live:
        while not end.is_set():
            page, own = scheduled(int(pid)), scheduled(os.getpid())
            seconds = asked(live, "stop", robot)
            times.append(round(seconds, 4))
            now, mine = scheduled(int(pid)), scheduled(os.getpid())
            trace = {
                "seconds": round(seconds, 3),
                "at": len(times),
                "page ran": most(page, now, 0),
                "page waited for a processor": most(page, now, 1),
                "main thread waited": round(since(page, now, main_thread, 1), 3),
                "operator waited for a processor": most(own, mine, 1)["all"],
                "load": os.getloadavg()[0],
            }
            slowest = max(slowest, trace, key=lambda one: one["seconds"])
            rest = max(0.0, seconds - trace["main thread waited"])
            itself = max(itself, {**trace, "seconds": rest}, key=lambda one: one["seconds"])
            asked(live, "release", robot)
            ordered = sorted(times)
            figures = {
                "STOPs": len(times),
                "median": ordered[len(times) // 2],
                "99 %": ordered[len(times) * 99 // 100],
                "over 0.3 s": sum(one > 0.3 for one in times),
                "slowest": slowest,
                "slowest itself": itself,
            }
            tell(figures)
            _read(live, EVERY, end)


def _read(live: ClientConnection, seconds: float, end: threading.Event) -> None:
    """Reads the page's changes for a time, as a browser does."""
    until = time.monotonic() + seconds
    while not end.is_set() and (left := until - time.monotonic()) > 0:
        with contextlib.suppress(TimeoutError):
            live.recv(left)


main()
