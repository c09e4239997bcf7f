"""A ROS node without rospy, for lightweight nodes: several can share one process and one thread.

rospy allows one node per process and needs a thread per connection. Names follow roscpp's NodeHandle.
"""

import logging
import struct
import time
import xmlrpc.client
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

import rosgraph
from genpy import DeserializationError, Time
from roscpp.msg import Logger
from roscpp.srv import (
    GetLoggers,
    GetLoggersResponse,
    SetLoggerLevel,
    SetLoggerLevelRequest,
    SetLoggerLevelResponse,
)
from rosgraph_msgs.msg import Clock, Log

from pioneer_node.conversions import frame_of
from pioneer_node.core.parameter import UNKNOWN
from tcpros.frame import LENGTH_SIZE
from tcpros.node import Node, Publication, ServiceError
from tcpros.node_context import PATIENCE, NodeContext
from tcpros.reactor import Timer
from tcpros.topic_source import Sender

STRICT = "strict_parameters"
"""Parameter, of a node or an enclosing namespace, that turns unknown parameters into errors."""
LOGGER = "rosout"
"""Logger whose lines reach the terminal, the log file and ``/rosout``, as in rospy."""

_CLOCK = struct.Struct("<II")
_LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_UNUSABLE = (DeserializationError, struct.error, ValueError, IndexError, UnicodeDecodeError)
"""Errors that deserialising a malformed message can raise."""


Received = Callable[[bytes | memoryview, str], object]
"""Callback: receives a serialised message, valid only during the call, and the sending node's name."""


class Lockstep(Protocol):
    """Exchanges messages by tokens instead of connections for a node in lockstep (docs/lockstep.md)."""

    def wants(self, topic: str) -> bool:
        """Returns whether any node in lockstep subscribes to a topic."""

    def note(self, publisher: "Publisher", data: bytes) -> None:
        """Records a message that the node publishes, for the next token."""

    def listen(self, topic: str, kind: Any, take: Received) -> bool:
        """Calls ``take`` for each message in tokens; returns whether connections carry the topic as well."""

    def takes(self, topic: str, sender: Sender, data: memoryview) -> bool:
        """Returns whether to accept a message received over a connection."""

    def tick(self, call: Callable[[], object]) -> None:
        """Registers ``call`` to run once per period."""


class MasterParameters:
    """Blocking client of a master's parameter API, with a time-out. Raises OSError, ProtocolError."""

    def __init__(self, uri: str, caller: str) -> None:
        self._uri, self._caller = uri, caller

    def ask(self, method: str, *arguments: Any) -> tuple[bool, Any]:
        """Returns whether the master reports success, and the value it returned."""
        with xmlrpc.client.ServerProxy(self._uri, transport=_Patient(), allow_none=True) as master:
            status, _, value = getattr(master, method)(self._caller, *arguments)  # type: ignore[misc]
        return status == 1, value


class _Patient(xmlrpc.client.Transport):
    """A connection that times out after some seconds without data."""

    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = PATIENCE
        return connection


class Publisher:
    """A topic that a node publishes."""

    def __init__(
        self,
        node: Node,
        publication: Publication,
        topic: str,
        latched: bool,
        lockstep: Lockstep | None,
    ) -> None:
        self.topic = topic  #: its resolved name
        self.latched = latched  #: whether new subscribers get the last message
        self._node = node
        self._publication = publication
        self._lockstep = lockstep

    def publish(self, message: Any) -> None:
        """Sends a message to all subscribers."""
        if self.latched or self._publication.subscribers or self._is_noted():
            self.send(bytes(frame_of(message)))

    def send(self, frame: bytes) -> None:
        """Sends a serialised message with its length prefix."""
        if self._lockstep is not None and self._is_noted():
            self._lockstep.note(self, frame[LENGTH_SIZE:])
        self._publication.send(frame)

    def _is_noted(self) -> bool:
        return self._lockstep is not None and (self.latched or self._lockstep.wants(self.topic))

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has subscribers; thread-safe."""
        return bool(self._publication.subscribers)

    def reaches(self, node: str) -> bool:
        """Returns whether ``node`` is connected as a subscriber."""
        return node in self._publication.subscribers.values()

    def close(self) -> None:
        """Withdraws the topic."""
        self._node.unpublish(self.topic)


class Ticker:
    """A periodic callback, created by `NodeHandle.every`."""

    def __init__(self, handle: "NodeHandle", period: float, call: Callable[[], object]) -> None:
        self._handle, self._period, self._call = handle, period, call
        self._timer: Timer | None = None

    def start(self) -> None:
        """Starts the timer, first call after one period; no effect if it is running."""
        if self._timer is None and self._handle.lockstep is None:
            self._timer = self._handle.call_later(self._period, self._due)

    def stop(self) -> None:
        """Stops the timer until the next `start`."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def now(self) -> None:
        """Calls now and restarts the period if the timer runs. No effect in lockstep, which calls once per period."""
        if self._handle.lockstep is None:
            if self._timer is not None:
                self._timer.cancel()
                self._due()
            else:
                self._call()

    def _due(self) -> None:
        self._timer = self._handle.call_later(self._period, self._due)
        self._call()


class NodeHandle:
    """One node: its names, parameters, time, topics and services. Not thread-safe: use it from the reactor's thread.

    Subscribes: ``/clock`` if ``/use_sim_time`` is true at startup.

    Publishes: ``/rosout``.

    Services: ``~get_loggers``, ``~set_logger_level``.

    Args:
        context: state shared by all nodes of the process.
        name: its resolved name.
        remappings: name remappings, resolved for this node.
        shut_down: called with the reason when the node is asked to shut down.
        wall_time: use wall time as ROS time even if ``/use_sim_time`` is set.
        logger: name of the process's logger in ``~get_loggers``.
    """

    def __init__(
        self,
        context: NodeContext,
        name: str,
        remappings: Mapping[str, str],
        shut_down: Callable[[str], object],
        wall_time: bool = False,
        logger: str = LOGGER,
    ) -> None:
        self.name = name
        self.lockstep: Lockstep | None = None  #: see `join`
        self.logger = logging.LoggerAdapter(logging.getLogger(LOGGER), {"node": self})
        self._reactor, self._remappings = context.reactor, remappings
        self._master = MasterParameters(context.master_uri, name)
        self._now = 0.0
        self._simulated = not wall_time and bool(self.parameter("/use_sim_time", False))
        self._node = Node(context, name, shut_down)
        self._rosout = self._node.publish("/rosout", Log, latching=True)
        if self._simulated:
            self._clock = self._node.subscribe("/clock", Clock, self._on_clock)
        self._node.serve(f"{name}/get_loggers", GetLoggers, partial(_loggers, logger))
        self._node.serve(f"{name}/set_logger_level", SetLoggerLevel, _set_level)

    def when_registered(self, done: Callable[[], object]) -> None:
        """Calls ``done`` once the master has registered all current publishers, subscribers and services."""
        self._node.when_registered(partial(self.guard, done))

    def register_again(self) -> None:
        """Registers all topics and services again after the master was restarted. The caller retries on failure."""
        self._node.register_again()

    def close(self, done: Callable[[], object]) -> None:
        """Unregisters the node from the master, then calls ``done``."""
        self._node.close(done)

    def join(self, lockstep: Lockstep) -> None:
        """Puts the node into lockstep, which sets its time from now on. Call it before creating topics and tickers."""
        self.lockstep, self._now = lockstep, 0.0
        if self._simulated:
            self._node.unsubscribe(self._clock)

    # Names and parameters

    def resolved(self, name: str) -> str:
        """Returns the resolved and remapped form of a graph name."""
        found = rosgraph.names.resolve_name(name, self.name)
        return str(self._remappings.get(found, found))

    def parameter(self, name: str, otherwise: Any) -> Any:
        """Returns a parameter's value, or ``otherwise`` if it is not set. Blocks until the master answers."""
        found, value = self._master.ask("getParam", self.resolved(name))
        return value if found else otherwise

    def found_parameter(self, name: str, otherwise: Any) -> Any:
        """Returns the parameter found by searching upwards from the node's namespace, else ``otherwise``."""
        found, key = self._master.ask("searchParam", name)
        return self.parameter(key, otherwise) if found else otherwise

    def parameters(self) -> dict[str, Any]:
        """Returns the node's private parameters, an empty dictionary if there are none; see `STRICT`."""
        values = self.parameter("~", {})
        UNKNOWN.strict = bool(self.found_parameter(STRICT, False))
        return (
            {name: values[name] for name in values if name != STRICT}
            if isinstance(values, dict)
            else {}
        )

    def set_parameter(self, name: str, value: Any) -> None:
        """Sets a parameter."""
        self._master.ask("setParam", self.resolved(name), value)

    def watch(self, name: str, changed: Callable[[Any], object]) -> None:
        """Calls ``changed`` with a parameter's value now and on every change; with None while it is not set."""
        self._node.watch(
            self.resolved(name), lambda value: self.guard(changed, None if value == {} else value)
        )

    # Time

    def now(self) -> float:
        """Returns ROS time [s]; 0 before the first ``/clock``."""
        return self._now if self._simulated else time.time()

    def stamp(self) -> Time:
        """Returns ROS time as a message stamp."""
        return Time.from_sec(self.now())

    def set_time(self, now: float) -> None:
        """Sets simulated time to ``now`` [s]."""
        self._now = now

    def time_text(self) -> str:
        """Returns the time field of a log line in rospy's format."""
        return f"{time.time():f}, {self._now:f}" if self._simulated else f"{time.time():f}"

    def call(self, call: Callable[[], object]) -> None:
        """Schedules ``call`` to run soon; may be called from any thread."""
        self._reactor.call(partial(self.guard, call))

    def call_later(self, delay: float, call: Callable[[], object]) -> Timer:
        """Schedules ``call`` to run after ``delay`` [s of wall time]."""
        return self._reactor.call_later(delay, partial(self.guard, call))

    def every(self, period: float, call: Callable[[], object]) -> Ticker:
        """Returns a timer that runs ``call`` every ``period`` [s of wall time], or once per period in lockstep."""
        if self.lockstep is not None:
            self.lockstep.tick(partial(self.guard, call))
        return Ticker(self, period, call)

    # Topics and services

    def advertise(self, topic: str, kind: Any, latch: bool = False) -> Publisher:
        """Returns a new publisher; with ``latch`` each new subscriber gets the last message."""
        name = self.resolved(topic)
        publication = self._node.publish(name, kind, latch)
        return Publisher(self._node, publication, name, latch, self.lockstep)

    def subscribe(self, topic: str, kind: Any, take: Callable[[Any, str], object]) -> "Subscriber":
        """Subscribes; calls ``take`` with each message and the name of the node that sent it."""
        name = self.resolved(topic)
        return Subscriber(self.lockstep, self._node, name, kind, _Reader(self, name, kind, take))

    def subscribe_serialised(self, topic: str, kind: Any, take: Received) -> "Subscriber":
        """Subscribes like `subscribe`, but passes messages in serialised form."""
        return Subscriber(
            self.lockstep, self._node, self.resolved(topic), kind, partial(self.guard, take)
        )

    def serve(
        self, service: str, kind: Any, answer: Callable[[Any], Any], may_wait: bool = False
    ) -> None:
        """Offers a service; ``answer`` turns a request into a response. The client gets its exceptions as errors.

        If it ``may_wait``, each call runs in its own thread.
        """

        def answered(data: bytes) -> bytes:
            try:
                return bytes(frame_of(answer(kind._request_class().deserialize(data))))
            except Exception as error:
                self.logger.exception("bad callback")
                raise ServiceError(f"error processing request: {error}") from error

        self._node.serve(self.resolved(service), kind, answered, may_wait)

    # Logging

    def publish_line(self, record: logging.LogRecord) -> None:
        """Sends a log line to ``/rosout``."""
        severities = {10: Log.DEBUG, 20: Log.INFO, 30: Log.WARN, 40: Log.ERROR, 50: Log.FATAL}
        line = Log(
            level=severities.get(record.levelno, Log.INFO),
            name=self.name,
            msg=record.getMessage().encode(errors="replace").decode(),
            file=record.filename,
            function=record.funcName,
            line=record.lineno,
        )
        line.header.stamp = self.stamp()
        self._rosout.send(bytes(frame_of(line)))

    def guard(self, call: Callable[..., object], *arguments: Any) -> None:
        """Runs a callback of the node; exceptions are logged and the node continues, as in rospy."""
        try:
            call(*arguments)
        except Exception:  # outermost handler of a callback
            self.logger.exception("bad callback")

    def _on_clock(self, data: memoryview, _sender: Sender) -> None:
        if len(data) == _CLOCK.size:
            seconds, nanoseconds = _CLOCK.unpack(data)
            self._now = seconds + 1e-9 * nanoseconds


class Subscriber:
    """A subscription of a node; ``received`` gets each message."""

    def __init__(
        self, lockstep: Lockstep | None, node: Node, topic: str, kind: Any, received: Received
    ) -> None:
        self.topic = topic  #: its resolved name
        self._lockstep, self._node, self._received = lockstep, node, received
        connected = lockstep is None or lockstep.listen(topic, kind, received)
        self._source = node.subscribe(topic, kind, self._hear) if connected else None

    def hears(self, node: str) -> bool:
        """Returns whether a publisher of ``node`` is connected."""
        return self._source is not None and node in self._source.publisher_names

    @property
    def headers(self) -> list[dict[str, str]]:
        """The connection headers of the connected publishers, with their messages' definition."""
        return [] if self._source is None else self._source.headers

    def close(self) -> None:
        """Ends the subscription."""
        if self._source is not None:
            self._node.unsubscribe(self._source)
            self._source = None

    def _hear(self, data: memoryview, sender: Sender) -> None:
        lockstep = self._lockstep
        if lockstep is None or lockstep.takes(self.topic, sender, data):
            self._received(data, sender.name)


class _Reader:
    """Deserialises the messages of one topic and passes on the valid ones."""

    def __init__(
        self, handle: NodeHandle, topic: str, kind: Any, take: Callable[[Any, str], object]
    ) -> None:
        self._handle, self._topic, self._kind, self._take = handle, topic, kind, take
        self._complained = False

    def __call__(self, data: bytes | memoryview, sender: str) -> None:
        message = self._kind()
        try:
            message.deserialize(bytes(data))
        except _UNUSABLE as error:
            if not self._complained:
                self._handle.logger.error(
                    "dropped an invalid message on %s from %s: %s", self._topic, sender, error
                )
            self._complained = True
            return
        self._handle.guard(self._take, message, sender)


def _loggers(name: str, _request: bytes) -> bytes:
    found = logging.getLogger(LOGGER).getEffectiveLevel()
    level = next(word for word, number in _LEVELS.items() if number >= found)
    return bytes(frame_of(GetLoggersResponse([Logger(name, level)])))


def _set_level(request: bytes) -> bytes:
    wanted = SetLoggerLevelRequest().deserialize(request).level.lower()
    logger = logging.getLogger(LOGGER)
    logger.setLevel(_LEVELS.get(wanted, logger.level))
    return bytes(frame_of(SetLoggerLevelResponse()))
