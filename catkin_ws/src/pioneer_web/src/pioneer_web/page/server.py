"""Web server for the page, its stream of changes, the map and the metrics; subscribes only while in use."""

import asyncio
import contextlib
import ssl
import time
import traceback
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import rospy
import uvicorn
from fastapi import FastAPI, Request, WebSocket, WebSocketDisconnect
from fastapi.staticfiles import StaticFiles
from nicegui import ui
from starlette.responses import Response

from pioneer_web.access.access_control import Access, Role
from pioneer_web.access.admission import Admission, admitted_protocol
from pioneer_web.access.guard import Guard
from pioneer_web.access.handshake import secured_protocol
from pioneer_web.command.command import CommandError, command_from_text
from pioneer_web.command.commander import Commander
from pioneer_web.foxglove.server import EXPIRED, Foxglove
from pioneer_web.page import page
from pioneer_web.state.feed import BEAT, Feed
from pioneer_web.state.figures import figures
from pioneer_web.state.stream import Stream

TAKEN_IN = 0.04
"""Delay from a beat until its data is sent to pages [s]."""
RETRY = 1.0
"""Retry interval if the master does not answer [s]."""
LINGER = 5.0
"""Time subscriptions stay open before a page connects, and after the last one closes: a reload finds its data [s]."""
SCRAPED = 60.0
"""Time subscriptions stay open after a request for metrics [s]."""


class Viewer:
    """The stream's connection to one page."""

    def __init__(self, socket: WebSocket) -> None:
        #: lags: whether it has missed a change since the last full snapshot
        self._socket, self.lags = socket, True
        self._next: asyncio.Queue[bytes] = asyncio.Queue(maxsize=1)

    def offer(self, changes: bytes) -> None:
        """Sends changes, or marks the page as lagging if the previous ones are still being sent."""
        try:
            self._next.put_nowait(changes)
        except asyncio.QueueFull:
            self.lags = True

    @property
    def is_free(self) -> bool:
        """Whether it can accept data now."""
        return self._next.empty()

    async def forward(self) -> None:
        """Sends offered data in an endless loop."""
        while True:
            await self._socket.send_bytes(await self._next.get())


class Server:
    """The web server of one fleet.

    Args:
        feed: source of the data shown.
        commander: executes commands.
        access: access control.
        take_in: called five times a second while pages are open, to add robots that have joined.
        static: folder of the page's static files.
        host, port: address to listen on.
        certificate, key: TLS files; None for no TLS.
    """

    def __init__(
        self, feed: Feed, commander: Commander, access: Access, take_in: Callable[[], None], static: Path, host: str,
        port: int, certificate: Path | None = None, key: Path | None = None,
    ) -> None:  # fmt: skip
        self._feed, self._commander, self._take_in = feed, commander, take_in
        self._colours: dict[str, str] = {}
        self._stream, self._viewers = Stream(_warn_of_value), set[Viewer]()
        self._wanted_until, self._woken = 0.0, asyncio.Event()
        self.foxglove = Foxglove()
        # A stop waits for no other command, and commands wait for nothing that viewers ask for.
        self._stops, self._commands = (
            ThreadPoolExecutor(1, "stop"),
            ThreadPoolExecutor(8, "command"),
        )
        app = FastAPI(lifespan=self._lifespan, docs_url=None, redoc_url=None, openapi_url=None)
        app.mount("/static", StaticFiles(directory=static))
        app.mount("/recordings", StaticFiles(directory=commander.recording.folder, check_dir=False))
        app.add_api_route("/map.png", self._map)
        app.add_api_route("/metrics", self._metrics)
        app.add_api_websocket_route("/live", self._live)
        app.add_api_websocket_route("/foxglove", self.foxglove.serve)
        app.add_api_websocket_route("/foxglove/{token}", self.foxglove.serve)
        page.build(lambda: self._want(LINGER))
        ui.run_with(
            app, title="Pioneer fleet", dark=None, show_welcome_message=False, tailwind=False
        )
        guard = Guard(
            app, access, (static / "login.html").read_text(), port, certificate is not None
        )
        self._uvicorn = _Uvicorn(
            uvicorn.Config(
                guard, host, port, log_level="warning", access_log=False, ws_per_message_deflate=False,
                ws_max_size=1 << 20, server_header=False, proxy_headers=False, http=_protocol(certificate, key),
                timeout_graceful_shutdown=1, loop="asyncio" if certificate else "auto",
            )
        )  # fmt: skip

    def run(self) -> None:
        """Serves until `end`."""
        self._uvicorn.run()

    def end(self) -> None:
        """Makes `run` return soon; thread-safe."""
        self._uvicorn.should_exit = True

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: FastAPI) -> AsyncIterator[None]:
        beating = asyncio.create_task(self._beat())
        yield
        beating.cancel()
        self.foxglove.close()

    async def _beat(self) -> None:
        """Updates all pages five times a second; sleeps while there are none."""
        while not rospy.is_shutdown():
            try:
                await self._update()
            except (OSError, rospy.ROSException) as error:
                rospy.logwarn_throttle(10.0, f"the master does not answer, trying again: {error}")
                await asyncio.sleep(RETRY)
            except Exception:  # noqa: BLE001 - the outermost loop: pages must not freeze because of one fault
                rospy.logerr_throttle(
                    60.0, f"the pages' update failed, trying again:\n{traceback.format_exc()}"
                )
                await asyncio.sleep(RETRY)

    async def _update(self) -> None:
        if not self._is_wanted():
            await asyncio.to_thread(self._feed.close)
            self._woken.clear()
            await self._woken.wait()
        await asyncio.to_thread(self._take_in)
        await asyncio.to_thread(self._feed.open)
        began = time.monotonic()
        self._feed.beat()
        await asyncio.sleep(TAKEN_IN)
        if self._viewers:
            await self._send()
        await asyncio.sleep(max(0.01, BEAT - (time.monotonic() - began)))

    def _want(self, seconds: float) -> None:
        """Keeps the subscriptions open for at least ``seconds`` [s] from now; opens them if necessary."""
        self._wanted_until = max(self._wanted_until, time.monotonic() + seconds)
        self._woken.set()

    def _is_wanted(self) -> bool:
        return bool(self._viewers) or time.monotonic() < self._wanted_until

    def _values(self) -> tuple[list[str], dict[str, Any]]:
        """Returns the robots' names and all values. Waits for the feed's lock, so not for the event loop."""
        self._feed.station.recording = self._commander.recording.file
        with self._feed.lock:
            names = [robot.name for robot in self._feed.station.robots]
            return names, self._feed.station.values(time.monotonic())

    async def _send(self) -> None:
        names, values = await asyncio.to_thread(self._values)
        if len(names) != len(self._colours):
            self._colours = dict(zip(names, page.colours(len(names)), strict=True))
        values["fleet"] = self._colours
        changes = self._stream.update(values)
        for viewer in self._viewers:
            if viewer.lags and viewer.is_free:
                viewer.lags = False
                viewer.offer(self._stream.whole())
            elif not viewer.lags and changes:
                viewer.offer(changes)

    async def _live(self, socket: WebSocket) -> None:
        """Serves one page: sends changes, receives commands."""
        await socket.accept()
        viewer = Viewer(socket)
        self._viewers.add(viewer)
        self._woken.set()
        forwarding = asyncio.create_task(viewer.forward())
        try:
            while socket.scope["still"]():
                with contextlib.suppress(TimeoutError):
                    text = await asyncio.wait_for(socket.receive_text(), LINGER)
                    if not socket.scope["still"]():
                        break
                    await socket.send_json(
                        {"answer": await self._answer(text, socket.scope["role"])}
                    )
            await socket.close(EXPIRED)
        except (WebSocketDisconnect, KeyError):  # KeyError: not a text frame
            pass
        finally:
            forwarding.cancel()
            self._viewers.discard(viewer)
            self._want(LINGER)

    async def _answer(self, text: str, role: Role) -> dict[str, Any]:
        try:
            if role < Role.OPERATOR:
                raise CommandError("this session is read-only")
            command = command_from_text(text, [robot.name for robot in self._feed.station.robots])
            executor = self._stops if command.do == "stop" else self._commands
            loop = asyncio.get_running_loop()
            return {
                "good": True,
                "text": await loop.run_in_executor(executor, self._commander.do, command),
            }
        except CommandError as error:
            return {"good": False, "text": str(error)}

    async def _map(self) -> Response:
        return Response(
            self._feed.map_png, media_type="image/png", headers={"Cache-Control": "no-cache"}
        )

    async def _metrics(self, _: Request) -> Response:
        self._want(SCRAPED)
        return Response(
            await asyncio.to_thread(self._figures), media_type="text/plain; version=0.0.4"
        )

    def _figures(self) -> bytes:
        with self._feed.lock:
            return figures(self._feed.station, len(self._viewers), time.monotonic())


def _warn_of_value(name: str, reason: str) -> None:
    rospy.logwarn("%s is not shown: %s", name, reason)


def _protocol(certificate: Path | None, key: Path | None) -> Any:
    """Returns uvicorn's HTTP protocol with limits for unfinished requests and handshakes; above TLS if there are files.

    Without session tickets. A ticket makes a connection readable although no data follows. Clients that then read from
    a blocking socket, such as the synchronous client of websockets, hang if they write at the same time.
    """
    admission = Admission()
    protocol = admitted_protocol(admission)
    if certificate is None:
        return protocol
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    context.num_tickets = 0  # type: ignore[attr-defined]
    return secured_protocol(protocol, context, admission)


class _Uvicorn(uvicorn.Server):
    """Leaves signal handling to the node."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield
