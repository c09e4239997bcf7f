"""``pioneer_bench web``: cost of the fleet page on the base station, by number of open pages."""

import argparse
import contextlib
import functools
import json
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import rospkg
from websockets.sync.client import ClientConnection, connect

from pioneer_bench.core.row import Row, table
from pioneer_bench.report import finish
from pioneer_harness.error import HarnessError
from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.proc import process_state
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

TOKEN = "the-token-of-this-bench"
CPU_GOALS = {1: 0.15, 10: 0.4}
BYTES_GOAL = 200e3
START = 120.0
ROUNDS = 100
"""Number of waypoints of a robot, 10 m apart."""
SETTLE = 6.0
"""Longer than subscriptions remain after the last page has closed [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--robots", type=int, default=15, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--pages", type=int, nargs="*", default=[0, 1, 5, 10], metavar="N", help="default: 0 1 5 10"
    )
    parser.add_argument(
        "--repetitions", type=int, default=3, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--seconds", type=float, default=5.0, help="length of each window [s]")


def run(options: argparse.Namespace) -> int:
    """Runs the bench; returns 0 if every goal is met, 1 if one is missed, 2 if the bench failed."""
    rows: list[Row] = []
    try:
        with _server(options.robots) as (url, pid):
            for count in options.pages:
                rows += _rows(url, pid, count, options)
    except (HarnessError, OSError) as error:
        print(f"the bench failed: {error}")
        return 2
    remark = (
        f"{options.robots} robots of a stand-in for the base station: odometry and its transforms at 100 Hz, scans of "
        "180 beams, costmaps and plans at 10 Hz."
    )
    return finish(options, "web", "The fleet page", rows, remark)


@contextlib.contextmanager
def _server(robots: int) -> Iterator[tuple[str, int]]:
    """Yields address and process id of a fleet page on the tests' stand-in fleet, with all robots driving."""
    stand_in = Path(rospkg.RosPack().get_path("pioneer_web")) / "test" / "e2e" / "stand_in.py"
    with (
        tempfile.TemporaryDirectory(prefix="pioneer-bench-") as folder,
        # rosmaster runs in this process and prints a traceback for each node that has ended.
        open(Path(folder) / "master.log", "w") as log, contextlib.redirect_stderr(log),
        Master() as master, PortReservation() as ports, ProcessGroup() as group,
    ):  # fmt: skip
        port = ports.take(18090)
        environment = {**master.environment, "PIONEER_WEB_TOKEN": TOKEN}
        command = [sys.executable, str(stand_in), str(robots), "100", "180"]
        group.start("robots", command, environment, Path(folder) / "robots.log")
        page = ["rosrun", "pioneer_web", "fleet_page", f"_port:={port}"]
        pid = group.start("page", page, environment, Path(folder) / "page.log")
        url = f"127.0.0.1:{port}"
        wait_until(lambda: _answers(group, url), "the page's server", START)
        with _page(url) as socket:
            for number in range(1, robots + 1):
                # To and fro, so that it drives, with plan and costmap, until the end of the bench.
                name = f"pioneer{number}"
                for round_ in range(ROUNDS):
                    place = {"x": 5.0 * (-1) ** round_, "y": 0.0, "append": round_ > 0}
                    sent = json.dumps({"do": "drive", "robots": [name], **place})
                    wait_until(functools.partial(_is_done, socket, sent), f"{name}'s goal", START)
        yield url, pid


def _answers(group: ProcessGroup, url: str) -> bool:
    group.check()
    return bool(_cookie(url))


def _cookie(url: str) -> str:
    """Returns the cookie of a new session; empty if the server does not answer yet."""
    try:
        with urllib.request.urlopen(f"http://{url}/login", TOKEN.encode(), timeout=5.0) as answer:
            return str(answer.headers["Set-Cookie"]).partition(";")[0]
    except OSError:
        return ""


def _page(url: str) -> ClientConnection:
    return connect(f"ws://{url}/live", additional_headers={"Cookie": _cookie(url)}, max_size=None)


def _is_done(socket: ClientConnection, command: str) -> bool:
    socket.send(command)
    while not isinstance(frame := socket.recv(START), str):
        pass
    return bool(json.loads(frame)["answer"]["good"])


def _rows(url: str, pid: int, count: int, options: argparse.Namespace) -> list[Row]:
    sizes = [0] * count
    with contextlib.ExitStack() as stack:
        for number in range(count):
            socket = stack.enter_context(_page(url))
            threading.Thread(target=_drain, args=(socket, sizes, number), daemon=True).start()
        time.sleep(
            SETTLE
        )  # not a wait for a condition: the first pictures must not count as running cost
        costs, flows = [], list[float]()
        for _ in range(options.repetitions):
            began, cpu, size = time.monotonic(), _cpu(pid), sum(sizes)
            time.sleep(options.seconds)
            took = time.monotonic() - began
            costs.append((_cpu(pid) - cpu) / took)
            flows.append((sum(sizes) - size) / took / max(1, count))
    rows = [Row(f"{count} pages: CPU of the server", "CPU-s/s", tuple(costs), CPU_GOALS.get(count))]
    if count:
        rows.append(
            Row(
                f"{count} pages: to each of them",
                "byte/s",
                tuple(flows),
                BYTES_GOAL if count == 1 else None,
            )
        )
    print(table(rows), flush=True)
    return rows


def _drain(socket: ClientConnection, sizes: list[int], number: int) -> None:
    for frame in socket:
        sizes[number] += len(frame)


def _cpu(pid: int) -> float:
    state = process_state(pid)
    if state is None:
        raise HarnessError("the page's server has ended")
    return state.cpu
