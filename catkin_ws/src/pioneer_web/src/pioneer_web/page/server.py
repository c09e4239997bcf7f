"""Web server for the page, its stream of changes, the map and the metrics; subscribes only while in use."""

import asyncio
import threading
import time
import traceback
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import rospy
from aiohttp import WSMsgType, web

from pioneer_node.core.parameter import ParameterError
from pioneer_web.access.access_control import Access, Role
from pioneer_web.access.guard import UNAUTHORISED, Guard, Session
from pioneer_web.access.listener import Listener, tls_context
from pioneer_web.command.command import CommandError, command_from_text
from pioneer_web.command.commander import Commander
from pioneer_web.foxglove.server import Foxglove
from pioneer_web.page.camera import image_topics, next_image
from pioneer_web.page.doctor import examine
from pioneer_web.shared_call import SharedCalls
from pioneer_web.state.feed import BEAT, Feed
from pioneer_web.state.figures import figures
from pioneer_web.state.palette import colours
from pioneer_web.state.stream import Stream

TAKEN_IN = 0.04
"""Delay from a beat until its data is sent to pages [s]."""
RETRY = 1.0
"""Retry interval if the master does not answer [s]."""
LINGER = 5.0
"""Time subscriptions stay open before a page connects, and after the last one closes: a reload finds its data [s]."""
SIGN_OF_LIFE = 1.0
"""Interval of updates without a change, by which pages know that the server lives [s]."""
NO_CHANGES = b"{}"
SCRAPED = 60.0
"""Time subscriptions stay open after a request for metrics [s]."""
ENDING = 1.0
"""Time-out for requests that are being answered when the server ends, and for closing a page's connection [s]."""
LONGEST_FRAME = 1 << 20
"""Maximum size of a frame from a page [bytes]."""
_CAMERAS = 4
"""Number of camera images that are awaited at the same time."""
_CONTENT_POLICY = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self' ws: wss:; base-uri 'none'; form-action 'self'"
}
_NOT_STORED = {"Cache-Control": "no-cache"}


class Viewer:
    """The stream's connection to one page."""

    def __init__(self, socket: web.WebSocketResponse) -> None:
        #: lags: whether it has missed a change since the last full snapshot
        self.lags = True
        self._socket = socket
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
        """Sends offered data until the page has disconnected."""
        try:
            while True:
                await self._socket.send_bytes(await self._next.get())
        except ConnectionError:
            return


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
        self,
        feed: Feed,
        commander: Commander,
        access: Access,
        take_in: Callable[[], None],
        static: Path,
        host: str,
        port: int,
        certificate: Path | None = None,
        key: Path | None = None,
    ) -> None:
        self.foxglove = Foxglove()
        self._feed = feed
        self._commander = commander
        self._take_in = take_in
        self._host = host
        self._port = port
        self._context = tls_context(certificate, key) if certificate and key else None
        self._static = static
        self._static_files = {
            f"/static/{path.relative_to(static)}" for path in static.rglob("*") if path.is_file()
        }
        login_page = (static / "login.html").read_text()
        self._guard = Guard(self._serve, access, login_page, port, self._context is not None)
        self._listener: Listener | None = None
        self._pages: dict[str, Callable[[web.BaseRequest, Session], Awaitable[web.StreamResponse]]]
        self._pages = {
            "/": self._page,
            "/map.png": self._map,
            "/metrics": self._metrics,
            "/live": self._live,
            "/cameras": self._cameras,
            "/camera": self._camera,
            "/doctor": self._doctor,
        }
        self._colours: dict[str, str] = {}
        self._stream = Stream(_warn_of_value)
        self._viewers: set[Viewer] = set()
        self._sent_at = 0.0
        self._wanted_until = 0.0
        self._woken = asyncio.Event()
        # A stop waits for no other command, and commands wait for nothing that viewers ask for.
        self._stops = ThreadPoolExecutor(1, "stop")
        self._commands = ThreadPoolExecutor(8, "command")
        self._looking = ThreadPoolExecutor(_CAMERAS, "camera")
        self._shared = SharedCalls()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended = asyncio.Event()
        self._ending = threading.Event()

    def run(self) -> None:
        """Serves until `end`.

        Raises:
            ParameterError: the address cannot be used.
        """
        asyncio.run(self._run())

    def end(self) -> None:
        """Makes `run` return soon; thread-safe."""
        self._ending.set()
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._ended.set)

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = web.Server(self._answer_request, access_log=None)
        try:
            self._listener = Listener(
                server, self._host, self._port, self._context, _warn_of_connection
            )
        except OSError as error:
            raise ParameterError(
                f"~host {self._host}, ~port {self._port}: {error.strerror or error}"
            ) from None
        tasks = [
            asyncio.create_task(self._listener.run()),
            asyncio.create_task(self._beat()),
            asyncio.create_task(self._ended.wait()),
        ]
        if self._ending.is_set():
            self._ended.set()
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            self.foxglove.close()
            await server.shutdown(ENDING)

    # ---- requests

    async def _answer_request(self, request: web.BaseRequest) -> web.StreamResponse:
        assert self._listener is not None
        with self._listener.answering(request):
            return await self._guard(request)

    async def _serve(self, request: web.BaseRequest, session: Session) -> web.StreamResponse:
        """Answers a request of an authenticated client."""
        if request.method not in ("GET", "HEAD"):
            raise web.HTTPMethodNotAllowed(request.method, ("GET", "HEAD"))
        path = request.path
        if path in self._pages:
            return await self._pages[path](request, session)
        if path == "/foxglove" or path.startswith("/foxglove/"):
            self._exempt(request)
            return await self.foxglove.serve(request, session)
        if path in self._static_files:
            return web.FileResponse(
                self._static / path.removeprefix("/static/"), headers=_NOT_STORED
            )
        folder, _, name = path.rpartition("/")
        if folder == "/recordings" and (file := self._recording(name)) is not None:
            return web.FileResponse(file)
        raise web.HTTPNotFound

    def _exempt(self, request: web.BaseRequest) -> None:
        assert self._listener is not None
        self._listener.becomes_socket(request)

    def _recording(self, name: str) -> Path | None:
        """Returns the path of a recording with this name; None if there is none."""
        files = {path.name: path for path in self._commander.recording.folder.glob("*.mcap")}
        return files.get(name)

    async def _page(self, _: web.BaseRequest, __: Session) -> web.StreamResponse:
        self._want(LINGER)
        return web.FileResponse(
            self._static / "index.html", headers={**_NOT_STORED, **_CONTENT_POLICY}
        )

    async def _map(self, _: web.BaseRequest, __: Session) -> web.Response:
        return web.Response(body=self._feed.map_png, content_type="image/png", headers=_NOT_STORED)

    async def _metrics(self, _: web.BaseRequest, __: Session) -> web.Response:
        self._want(SCRAPED)
        body = await asyncio.to_thread(self._figures)
        return web.Response(body=body, headers={"Content-Type": "text/plain; version=0.0.4"})

    def _figures(self) -> bytes:
        with self._feed.lock:
            return figures(self._feed.station, len(self._viewers), time.monotonic())

    async def _cameras(self, _: web.BaseRequest, __: Session) -> web.Response:
        """Answers with the topics of camera images as JSON."""
        return web.json_response(await self._look(image_topics))

    async def _camera(self, request: web.BaseRequest, _: Session) -> web.Response:
        """Answers with the next image of the query's ``topic``, or the reason why there is none."""
        topic = request.query.get("topic", "")
        if topic not in await self._look(image_topics):
            return web.Response(text=f"there are no images on {topic[:80]!r}", status=404)
        try:
            image = await self._look(next_image, topic)
        except (rospy.ROSException, ValueError) as error:
            return web.Response(text=str(error), status=503)
        return web.Response(body=image, content_type="image/jpeg", headers=_NOT_STORED)

    async def _look(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """Calls a function that waits for the master or a camera in a thread that commands do not need."""

        async def called() -> Any:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(self._looking, call, *arguments)

        return await self._shared.result((call, *arguments), called)

    async def _doctor(self, _: web.BaseRequest, __: Session) -> web.Response:
        """Answers with the doctor's findings as JSON."""
        return web.json_response(await self._shared.result(examine, examine))

    # ---- the stream of changes, and commands

    async def _live(self, request: web.BaseRequest, session: Session) -> web.WebSocketResponse:
        """Serves one page: sends changes, receives commands."""
        socket = web.WebSocketResponse(compress=False, max_msg_size=LONGEST_FRAME, timeout=ENDING)
        await socket.prepare(request)
        self._exempt(request)
        viewer = Viewer(socket)
        self._viewers.add(viewer)
        self._woken.set()
        forwarding = asyncio.create_task(viewer.forward())
        watching = asyncio.create_task(_close_when_expired(socket, session))
        try:
            async for message in socket:
                if message.type != WSMsgType.TEXT:
                    break
                await session.turn(len(message.data))
                if not session.is_valid():
                    break
                answer = await self._answer(message.data, session.role)
                await socket.send_json({"answer": answer})
            if not session.is_valid():
                await socket.close(code=UNAUTHORISED)
        except ConnectionError:  # it has disconnected before its answer
            pass
        finally:
            forwarding.cancel()
            watching.cancel()
            self._viewers.discard(viewer)
            self._want(LINGER)
        return socket

    async def _answer(self, text: str, role: Role) -> dict[str, Any]:
        try:
            if role < Role.OPERATOR:
                raise CommandError("this session is read-only")
            command = command_from_text(text, [robot.name for robot in self._feed.station.robots])
            executor = self._stops if command.do == "stop" else self._commands
            loop = asyncio.get_running_loop()
            words = await loop.run_in_executor(executor, self._commander.do, command)
        except CommandError as error:
            return {"good": False, "text": str(error)}
        return {"good": True, "text": words}

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
        recording = self._commander.recording
        self._feed.station.recording = recording.file
        self._feed.station.recording_fault = recording.fault
        with self._feed.lock:
            station = self._feed.station
            now = time.monotonic()
            station.note_faults(now, time.time())
            return [robot.name for robot in station.robots], station.values(now)

    async def _send(self) -> None:
        names, values = await asyncio.to_thread(self._values)
        if len(names) != len(self._colours):
            self._colours = dict(zip(names, colours(len(names)), strict=True))
        values["fleet"] = self._colours
        changes = self._stream.update(values)
        now = time.monotonic()
        if changes:
            self._sent_at = now
        elif now - self._sent_at > SIGN_OF_LIFE:
            changes, self._sent_at = NO_CHANGES, now
        for viewer in self._viewers:
            if viewer.lags and viewer.is_free:
                viewer.lags = False
                viewer.offer(self._stream.whole())
            elif not viewer.lags and changes:
                viewer.offer(changes)


async def _close_when_expired(socket: web.WebSocketResponse, session: Session) -> None:
    """Closes a page's connection when its session has expired, also if it sends no commands."""
    while session.is_valid():
        await asyncio.sleep(RETRY)
    await socket.close(code=UNAUTHORISED)


def _warn_of_value(name: str, reason: str) -> None:
    rospy.logwarn("%s is not shown: %s", name, reason)


def _warn_of_connection(reason: str) -> None:
    rospy.logwarn_throttle(10.0, f"a connection cannot be accepted, trying again: {reason}")
