"""Serves Foxglove's WebSocket protocol: raw topics, services, publishing. Clients share one connection per topic."""

import asyncio
import contextlib
import itertools
import math
import threading
import time
import uuid
from collections.abc import Mapping
from typing import Any

import genpy
import rosgraph.names
import rospy
from aiohttp import WSMessage, WSMsgType, web

from pioneer_web.access.access_control import Role
from pioneer_web.access.guard import UNAUTHORISED, Session
from pioneer_web.foxglove.frames import Frames
from pioneer_web.foxglove.message_class import known_class, message_class, service_class
from pioneer_web.foxglove.wire import (
    ENCODING,
    PROTOCOLS,
    Call,
    Message,
    WireError,
    frame_from_client,
    message_frame,
    numbers,
    request_from_text,
    response_frame,
    rows,
)
from tcpros.client import Client, ClientError

LOOK_EVERY = 1.0
"""Poll interval for topics and services at the master while a client is connected [s]."""
SOONEST = 0.2
"""Shortest interval between polls, if a client subscribes [s]."""
URIS_EVERY = 5.0
"""Interval for reading the URIs of publishing nodes again [s]."""
CLOSING = 1.0
"""Time-out for a client's answer when its connection is closed [s]."""
CONNECTING = 1.0
"""Time a new publisher waits for its first subscriber [s]."""
BACKLOG, BACKLOG_BYTES = 200, 1 << 24
"""Queue size for a slow client: number of frames, and total size [bytes]; further frames are dropped."""
LONGEST_FRAME = 1 << 20
"""Maximum size of a client's frame [bytes]."""
LONGEST_REQUEST = 1 << 18
"""Maximum length of a client's JSON request [characters]."""
READ_ONLY = "this token is read-only"
_SCHEMA = "ros1msg"
_CAPABILITIES = ["clientPublish", "services"]


class Visitor:
    """One client: its subscriptions and publishers."""

    def __init__(self, socket: web.WebSocketResponse, session: Session) -> None:
        self.socket = socket
        self.session = session
        self.subscriptions: dict[int, str] = {}
        self.publishers: dict[int, rospy.Publisher] = {}
        self.channels: dict[str, int] = {}
        self.services: dict[str, int] = {}
        self._queue: asyncio.Queue[bytes | dict[str, Any]] = asyncio.Queue(BACKLOG)
        self._queued_bytes = 0

    @property
    def may_act(self) -> bool:
        """Whether the client may publish and call services."""
        return self.session.role >= Role.OPERATOR

    def subscribe(self, number: int, channel: int) -> None:
        """Subscribes to a channel under a number of the client's; ignores a channel that is gone.

        Raises:
            WireError: the client is subscribed to it already. Else one client could multiply a topic's traffic.
        """
        topic = next((topic for topic, known in self.channels.items() if known == channel), None)
        if topic is None:
            return
        if topic in self.subscriptions.values():
            raise WireError(f"{topic} is subscribed already")
        self.subscriptions[number] = topic

    def send(self, frame: bytes | dict[str, Any]) -> None:
        """Queues a frame for sending; drops it if the queue is full. A frame of any size fits into an empty one."""
        size = len(frame) if isinstance(frame, bytes) else 0
        if self._queued_bytes and self._queued_bytes + size > BACKLOG_BYTES:
            return
        with contextlib.suppress(asyncio.QueueFull):
            self._queue.put_nowait(frame)
            self._queued_bytes += size

    def complain(self, text: str) -> None:
        """Shows an error to the user."""
        self.send({"op": "status", "level": 2, "message": text})

    async def forward(self) -> None:
        """Sends queued frames until the client has disconnected."""
        with contextlib.suppress(ConnectionError):
            while True:
                frame = await self._queue.get()
                if isinstance(frame, bytes):
                    await self.socket.send_bytes(frame)
                    self._queued_bytes -= len(frame)
                else:
                    await self.socket.send_json(frame)


class Foxglove:
    """The endpoint for Foxglove, Lichtblick and other clients of the protocol.

    Threads: the server's event loop; one that reads all subscribed topics (`Frames`).
    """

    def __init__(self) -> None:
        # Separate node name: publishers drop a connection when another with the same name arrives, here the page's.
        name = f"{rospy.get_name()}_foxglove"
        self._client = Client(rosgraph.get_master_uri(), name)
        self._visitors: set[Visitor] = set()
        self._frames = Frames(name, self._deliver)
        self._uris: dict[str, str] = {}
        self._uris_read = -math.inf
        self._numbers: dict[tuple[str, str], int] = {}
        self._fresh_numbers = itertools.count(1)
        self._hurry = asyncio.Event()
        self._state: tuple[dict[str, str], dict[str, list[str]], dict[str, str]] = ({}, {}, {})
        self._looking: asyncio.Task[None] | None = None

    def close(self) -> None:
        """Ends all connections to the fleet."""
        self._frames.close()

    async def serve(self, request: web.BaseRequest, session: Session) -> web.WebSocketResponse:
        """Serves one client until it disconnects."""
        socket = web.WebSocketResponse(
            protocols=PROTOCOLS, compress=False, max_msg_size=LONGEST_FRAME, timeout=CLOSING
        )
        await socket.prepare(request)
        visitor = Visitor(socket, session)
        visitor.send(
            {
                "op": "serverInfo", "name": "Pioneer fleet", "sessionId": uuid.uuid4().hex,
                "metadata": {"ROS_DISTRO": "noetic"}, "supportedEncodings": [ENCODING],
                "capabilities": _CAPABILITIES if visitor.may_act else [],
            }
        )  # fmt: skip
        self._visitors.add(visitor)
        forwarding = asyncio.create_task(visitor.forward())
        if self._looking is None:
            self._looking = asyncio.create_task(self._look())
        else:
            self._announce(visitor)
        try:
            async for message in socket:
                if message.type not in (WSMsgType.TEXT, WSMsgType.BINARY):  # it broke the protocol
                    break
                await session.turn(len(message.data))
                await self._take(visitor, message)
            if not session.is_valid():
                await socket.close(code=UNAUTHORISED)
        finally:
            forwarding.cancel()
            self._leave(visitor)
        return socket

    def _leave(self, visitor: Visitor) -> None:
        self._visitors.discard(visitor)
        for publisher in visitor.publishers.values():
            publisher.unregister()
        self._follow()
        if not self._visitors and self._looking is not None:
            self._looking.cancel()
            self._looking = None

    async def _take(self, visitor: Visitor, message: WSMessage) -> None:
        try:
            if message.type == WSMsgType.BINARY:
                self._frame(visitor, frame_from_client(message.data))
            elif len(message.data) > LONGEST_REQUEST:
                raise WireError(f"a request has at most {LONGEST_REQUEST} characters")
            else:
                await self._request(visitor, *request_from_text(message.data))
        except WireError as error:
            visitor.complain(str(error))

    async def _request(self, visitor: Visitor, op: str, fields: Mapping[str, Any]) -> None:
        if op == "advertise" and not visitor.may_act:
            raise WireError(READ_ONLY)
        match op:
            case "subscribe":
                for one in rows(fields, "subscriptions", id=int, channelId=int):
                    visitor.subscribe(one["id"], one["channelId"])
                self._hurry.set()
            case "unsubscribe":
                for number in numbers(fields, "subscriptionIds"):
                    visitor.subscriptions.pop(number, None)
                self._follow()
            case "advertise":
                for one in rows(fields, "channels", id=int, topic=str, schemaName=str):
                    await self._advertise(visitor, one)
            case "unadvertise":
                for number in numbers(fields, "channelIds"):
                    if publisher := visitor.publishers.pop(number, None):
                        publisher.unregister()

    async def _advertise(self, visitor: Visitor, channel: Mapping[str, Any]) -> None:
        kind = await asyncio.to_thread(message_class, channel["schemaName"])
        if kind is None or channel.get("encoding", ENCODING) != ENCODING:
            raise WireError(
                f"{channel['topic'][:80]}: cannot publish {channel['schemaName'][:80]} encoded other than {ENCODING}"
            )
        if not rosgraph.names.is_legal_name(channel["topic"]) or not channel["topic"].startswith(
            "/"
        ):
            raise WireError(f"{channel['topic'][:80]!r} is not a topic's name")
        visitor.publishers[channel["id"]] = await asyncio.to_thread(
            _publisher, channel["topic"], kind
        )

    def _frame(self, visitor: Visitor, frame: Message | Call) -> None:
        if not visitor.may_act:
            if isinstance(frame, Call):
                visitor.send(_failure(frame, READ_ONLY))
                return
            raise WireError(READ_ONLY)
        if isinstance(frame, Call):
            asyncio.get_running_loop().create_task(self._call(visitor, frame))
            return
        publisher = visitor.publishers.get(frame.channel)
        if publisher is None:
            raise WireError(f"channel {frame.channel} is not advertised")
        try:
            publisher.publish(publisher.data_class().deserialize(frame.body))
        except (genpy.DeserializationError, rospy.ROSException) as error:
            raise WireError(f"{publisher.name}: {error}") from None

    async def _call(self, visitor: Visitor, call: Call) -> None:
        names = {number: name for name, number in visitor.services.items()}
        try:
            if call.service not in names:
                raise WireError("no such service")
            visitor.send(
                response_frame(
                    call, await asyncio.to_thread(self._called, names[call.service], call.body)
                )
            )
        except (WireError, ClientError, OSError) as error:
            visitor.send(_failure(call, str(error)))

    def _called(self, name: str, body: bytes) -> bytes:
        with self._client.service(name, "*") as connection:
            return connection.call_raw(body)

    async def _look(self) -> None:
        """Polls the master for topics and services while clients are connected."""
        while not rospy.is_shutdown():
            with contextlib.suppress(
                ClientError, OSError
            ):  # the master is unavailable: retried below
                self._hurry.clear()
                read = {
                    topic for visitor in self._visitors for topic in visitor.subscriptions.values()
                }
                self._state = await asyncio.to_thread(self._graph, read)
                self._forget_numbers()
                for visitor in self._visitors:
                    self._announce(visitor)
                self._follow()
            for visitor in [one for one in self._visitors if not one.session.is_valid()]:
                await visitor.socket.close(code=UNAUTHORISED)
            await asyncio.sleep(SOONEST)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._hurry.wait(), LOOK_EVERY - SOONEST)

    def _forget_numbers(self) -> None:
        """Forgets the numbers of topics and services that are gone, which any client of the master can add."""
        topics, _, services = self._state
        known = {("topic", name) for name in topics} | {("service", name) for name in services}
        self._numbers = {key: number for key, number in self._numbers.items() if key in known}

    def _graph(self, read: set[str]) -> tuple[dict[str, str], dict[str, list[str]], dict[str, str]]:
        """Returns each topic's type, the URIs of the publishers of those in ``read``, and each service's type."""
        publishers, _, services = self._client.ask_master("getSystemState")
        types = dict(self._client.ask_master("getTopicTypes"))
        mine = rospy.get_name()
        nodes = {topic: set(who) - {mine} for topic, who in publishers if set(who) - {mine}}
        topics = {
            topic: types[topic]
            for topic in nodes
            if message_class(types.get(topic, "")) is not None
        }
        uris = self._uris_of(set().union(*(nodes.get(topic, set()) for topic in read)))
        sources = {
            topic: sorted(uris[node] for node in nodes.get(topic, set()) if node in uris)
            for topic in read
        }
        known = self._state[2]
        kinds = {
            name: known.get(name) or self._service_type(name)
            for name, _ in services
            if "logger" not in name
        }
        return topics, sources, {name: kind for name, kind in kinds.items() if kind}

    def _uris_of(self, nodes: set[str]) -> dict[str, str]:
        """Returns the URIs of nodes, which change when a node is started again."""
        if time.monotonic() - self._uris_read > URIS_EVERY:
            self._uris.clear()
            self._uris_read = time.monotonic()
        self._uris = {node: uri for node, uri in self._uris.items() if node in nodes}
        for node in nodes - self._uris.keys():
            with contextlib.suppress(ClientError):  # it has just left
                self._uris[node] = str(self._client.ask_master("lookupNode", node))
        return self._uris

    def _service_type(self, name: str) -> str:
        try:
            with self._client.service(name, "*", probe="1") as connection:
                kind = connection.header.get("type", "")
        except (ClientError, OSError):
            return ""
        return kind if service_class(kind) is not None else ""

    def _announce(self, visitor: Visitor) -> None:
        """Sends a client the topics and services that are new, and the topics that are gone."""
        topics, _, services = self._state
        fresh = {topic: kind for topic, kind in topics.items() if topic not in visitor.channels}
        gone = [topic for topic in visitor.channels if topic not in topics]
        if gone:
            visitor.send(
                {"op": "unadvertise", "channelIds": [visitor.channels.pop(topic) for topic in gone]}
            )
        if fresh:
            channels = [self._channel(topic, kind) for topic, kind in fresh.items()]
            visitor.channels.update((one["topic"], one["id"]) for one in channels)
            visitor.send({"op": "advertise", "channels": channels})
        ended = [name for name in visitor.services if name not in services]
        if ended:
            ids = [visitor.services.pop(name) for name in ended]
            visitor.send({"op": "unadvertiseServices", "serviceIds": ids})
        added = {name: kind for name, kind in services.items() if name not in visitor.services}
        if added and visitor.may_act:
            offers = [self._service(name, kind) for name, kind in added.items()]
            visitor.services.update((one["name"], one["id"]) for one in offers)
            visitor.send({"op": "advertiseServices", "services": offers})

    def _number(self, kind: str, name: str) -> int:
        if (kind, name) not in self._numbers:
            self._numbers[kind, name] = next(self._fresh_numbers)
        return self._numbers[kind, name]

    def _channel(self, topic: str, kind: str) -> dict[str, Any]:
        schema = {
            "schemaName": kind,
            "schemaEncoding": _SCHEMA,
            "schema": known_class(kind)._full_text,
        }
        return {"id": self._number("topic", topic), "topic": topic, "encoding": ENCODING, **schema}

    def _service(self, name: str, kind: str) -> dict[str, Any]:
        found = service_class(kind)
        halves = {"request": found._request_class, "response": found._response_class}
        schemas = {
            half: {
                "encoding": ENCODING,
                "schemaName": one._type,
                "schemaEncoding": _SCHEMA,
                "schema": one._full_text,
            }
            for half, one in halves.items()
        }
        old = {f"{half}Schema": one["schema"] for half, one in schemas.items()}
        return {"id": self._number("service", name), "name": name, "type": kind, **schemas, **old}

    def _follow(self) -> None:
        """Connects to all topics that clients subscribe to; closes the others."""
        wanted = {topic for visitor in self._visitors for topic in visitor.subscriptions.values()}
        self._frames.follow({topic: self._state[1].get(topic, []) for topic in wanted})

    def _deliver(self, topic: str, stamp: int, body: bytes) -> None:
        for visitor in self._visitors:
            for number, one in visitor.subscriptions.items():
                if one == topic:
                    visitor.send(message_frame(number, stamp, body))


def _failure(call: Call, reason: str) -> dict[str, Any]:
    return {
        "op": "serviceCallFailure",
        "serviceId": call.service,
        "callId": call.number,
        "message": reason,
    }


class _Listeners(rospy.SubscribeListener):
    def __init__(self) -> None:
        super().__init__()
        self.arrived = threading.Event()

    def peer_subscribe(self, *_: object) -> None:
        self.arrived.set()


def _publisher(topic: str, kind: Any) -> rospy.Publisher:
    """Returns a publisher after its first subscriber has connected, or after `CONNECTING`.

    It is not latched: a robot must not get an old waypoint again when its gateway reconnects.
    """
    listeners = _Listeners()
    publisher = rospy.Publisher(topic, kind, subscriber_listener=listeners, queue_size=20)
    listeners.arrived.wait(CONNECTING)
    return publisher
