"""Uses the fleet page and its Foxglove endpoint as a hostile viewer, and as a client without a token.

Run it as ``page.py SEED URL VIEWER_TOKEN`` until SIGINT; each second it writes a line of JSON with the number of
inputs per target. Beside it, three viewers stay connected: a page, a Foxglove client that subscribes to every topic,
and one that does so and never reads.
"""

import contextlib
import http.client
import json
import random
import signal
import struct
import sys
import threading
import time
from collections import Counter, deque
from urllib.parse import urlsplit

import hostile
from figures import tell
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

RATE = 10.0
"""Inputs a second."""
KEPT = 8
"""Number of connections that are kept open after an input."""
PATIENCE = 10.0
PATHS = (
    "/",
    "/metrics",
    "/map.png",
    "/static/fleet.js",
    "/recordings/",
    "/recordings/../x",
    "/%00",
    "/login",
)
TYPES = ("std_msgs/String", "os/path", "hangs/X", "a/b/c", "../x/Y", "geometry_msgs/Twist", "\0/x")
DOINGS = (
    "stop",
    "drive",
    "release",
    "cancel",
    "spawn",
    "simulate",
    "patrol",
    "record",
    "seek",
    "locate",
)
PROTOCOL = "foxglove.websocket.v1"


class Viewer:
    """A client of the page at ``url``; its inputs are drawn from ``rng``."""

    def __init__(self, url: str, token: str, rng: random.Random) -> None:
        self.url, self.token, self.rng = url, token, rng
        parts = urlsplit(url)
        self.host, self.port = str(parts.hostname), int(parts.port or 80)
        self.kept = deque[ClientConnection]()
        self.cookie = self._login()

    def _login(self) -> str:
        connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        with contextlib.closing(connection):
            connection.request("POST", "/login", self.token)
            answer = connection.getresponse()
            assert answer.status == 204, f"login: HTTP {answer.status}"
            return str(answer.headers["Set-Cookie"]).partition(";")[0]

    def connected(self, path: str, cookie: str, **options: object) -> ClientConnection:
        """Returns a new WebSocket to a path."""
        return connect(
            self.url.replace("http", "ws") + path,
            additional_headers={"Cookie": cookie},
            open_timeout=PATIENCE,
            max_size=None,
            **options,  # type: ignore[arg-type]
        )

    def request(self) -> None:
        """Sends an HTTP request, with a cookie or a false one, and reads the answer."""
        cookie = self.rng.choice((self.cookie, self.cookie, "", "pioneer=x", "a" * 5000))
        method = self.rng.choice(("GET", "GET", "HEAD", "POST", "PUT", "X"))
        connection = http.client.HTTPConnection(self.host, self.port, timeout=PATIENCE)
        with contextlib.closing(connection):
            body = self.rng.randbytes(self.rng.choice((0, 10, 3000)))
            headers = {"Cookie": cookie} if cookie else {}
            connection.putrequest(method, self.rng.choice(PATHS), skip_accept_encoding=True)
            for name, value in headers.items():
                connection.putheader(name, value)
            connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            connection.getresponse().read()

    def live(self) -> None:
        """Sends commands and nonsense to a page's connection."""
        rng = self.rng
        socket = self.connected("/live", self.cookie)
        for _ in range(rng.randrange(1, 20)):
            command = {
                "do": rng.choice(DOINGS),
                "robots": rng.choice((["pioneer1"], "x", [[]], None)),
            }
            frame = rng.choice(
                (json.dumps(command), json.dumps(hostile.junk(rng), default=str), "{" * 3000)
            )
            socket.send(rng.choice((frame, frame, rng.randbytes(50))))
        self._keep(socket)

    def foxglove(self) -> None:
        """Sends valid and invalid requests to the Foxglove endpoint."""
        rng = self.rng
        path = f"/foxglove/{self.token}"
        socket = self.connected(path, "", subprotocols=[PROTOCOL])
        for _ in range(rng.randrange(1, 20)):
            number = rng.choice((0, 1, -1, 2**70, "1", None, rng.randrange(200)))
            channel = {"id": number, "topic": rng.choice(hostile.ODD[:12]), "encoding": "ros1"}
            channel["schemaName"] = rng.choice(TYPES)
            subscription = {"id": number, "channelId": rng.randrange(100)}
            request = rng.choice(
                (
                    {"op": "advertise", "channels": [channel]},
                    {"op": "subscribe", "subscriptions": [subscription] * rng.randrange(30)},
                    {"op": "unsubscribe", "subscriptionIds": [number]},
                    {
                        "op": rng.choice(("unadvertise", "x", "getParameters")),
                        "channelIds": [number],
                    },
                    hostile.junk(rng),
                )
            )
            binary = struct.pack("<BI", rng.randrange(4), rng.randrange(2**32)) + rng.randbytes(9)
            socket.send(rng.choice((json.dumps(request, default=str), binary)))
        self._keep(socket)

    def _keep(self, socket: ClientConnection) -> None:
        self.kept.append(socket)
        if len(self.kept) > KEPT:
            self.kept.popleft().close()


def subscribe_to_all(socket: ClientConnection, seconds: float) -> None:
    """Reads for a time and subscribes to every channel that is advertised."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        try:
            frame = socket.recv(left)
        except TimeoutError:
            return
        fields = json.loads(frame) if isinstance(frame, str) else {}
        numbers = [channel["id"] for channel in fields.get("channels", [])]
        rows = [{"id": number, "channelId": number} for number in numbers]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": rows}))


def stay(viewer: Viewer, path: str, cookie: str, seconds: float, end: threading.Event) -> None:
    """Keeps a viewer connected: one that reads for this long each time, then waits for ten times as long."""
    while not end.is_set():
        with (
            contextlib.suppress(OSError, EOFError, WebSocketException),
            viewer.connected(path, cookie, subprotocols=[PROTOCOL]) as socket,
        ):
            subscribe_to_all(socket, seconds)
            end.wait(10 * seconds if seconds < PATIENCE else 0)


def main() -> None:
    """Runs until SIGINT."""
    seed, url, token = sys.argv[1:]
    viewer = Viewer(url, token, random.Random(int(seed)))
    end, counts, told = threading.Event(), Counter[str](), 0.0
    signal.signal(signal.SIGINT, lambda *_: end.set())
    foxglove = f"/foxglove/{token}"
    for path, cookie, seconds in (
        ("/live", viewer.cookie, 3600.0),
        (foxglove, "", 3600.0),
        (foxglove, "", 3.0),
    ):
        threading.Thread(
            target=stay, args=(viewer, path, cookie, seconds, end), daemon=True
        ).start()
    actions = {"page": viewer.request, "page's commands": viewer.live, "Foxglove": viewer.foxglove}
    while not end.wait(1.0 / RATE):
        name = viewer.rng.choice([*actions])
        # A refusal or a closed connection is an answer, too.
        with contextlib.suppress(OSError, EOFError, WebSocketException, http.client.HTTPException):
            actions[name]()
        counts[name] += 1
        if time.monotonic() - told > 1.0:
            told = time.monotonic()
            tell(counts)


main()
