"""Publishes and subscribes through tokens instead of rospy's connections, for a process in lockstep.

In rospy, callbacks run whenever a message arrives and timers whenever a thread wakes up. Here both run at a fixed point
of the period, in an order that depends only on the messages (docs/lockstep.md).
"""

import io
from collections.abc import Callable
from typing import Any, Self

import rospy
from pioneer_msgs.msg import LockstepMessage
from rospy.msg import args_kwds_to_message

from pioneer_node.adapters import exchange
from pioneer_node.adapters.exchange import is_connected
from pioneer_node.adapters.launch_door import launch_door
from pioneer_node.core.parameter import ParameterError
from tcpros.topic_source import RELAYED_NODE


class Exchange(exchange.Exchange):
    """Replaces ``rospy.Publisher``, ``Subscriber`` and ``Timer`` in this process by token-based versions.

    Ordinary rospy subscribers still receive what is published. Subscribers still receive messages from nodes outside
    the lockstep, except scans, point clouds, odometry, ``/clock`` and ``/tf``.
    """

    current: "Exchange | None" = None
    """The process's instance; None if it is not in lockstep."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.timers: list[_Timer] = []

    def install(self, follows: bool = True) -> Self:
        """Replaces rospy's classes; if this process ``follows`` the tokens, they set ROS time. Returns itself.

        Raises:
            ParameterError: the package that patches rospy is missing or switched off.
        """
        door = launch_door()
        if door is None:
            raise ParameterError("lockstep needs the package pioneer_launch, which is not built")
        try:
            door.replace_topics(_Publisher, _Subscriber, _Timer, owns_time=follows)
        except door.SwitchedOffError as error:
            raise ParameterError(str(error)) from None
        Exchange.current = self
        return self

    def run_timers(self) -> None:
        """Calls the timers that are due."""
        for timer in tuple(self.timers):
            timer.run_if_due(rospy.Time.now())


def set_time(now: rospy.Time) -> None:
    """Sets ROS time in this process."""
    door = launch_door()
    assert door is not None, "only while installed"
    door.set_ros_time(now)


def _exchange() -> Exchange:
    assert Exchange.current is not None, "only while installed"
    return Exchange.current


def _serialised(message: Any) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


class _Publisher(rospy.topics.Publisher):  # type: ignore[misc]
    """Publishes as rospy does, and adds the message to the next token."""

    def __init__(
        self, name: str, data_class: Any, *args: Any, latch: bool = False, **options: Any
    ) -> None:
        super().__init__(name, data_class, *args, latch=latch, **options)
        self._latch = latch

    def publish(self, *args: Any, **fields: Any) -> None:
        """Publishes a message, given as an object or by its fields."""
        message, exchange = args_kwds_to_message(self.data_class, args, fields), _exchange()
        if self._latch or exchange.wants(self.resolved_name):
            latched_by = id(self) if self._latch else None
            exchange.publish(self.resolved_name, _serialised(message), latched_by)
        super().publish(message)

    def get_num_connections(self) -> int:
        """Returns the number of subscribers; all those in lockstep count as one."""
        return int(super().get_num_connections()) + _exchange().wants(self.resolved_name)

    def unregister(self) -> None:
        """Unregisters the topic."""
        _exchange().forget(self.resolved_name, id(self))
        super().unregister()


class _Subscriber(rospy.topics.Subscriber):  # type: ignore[misc]
    """Receives messages from tokens, and over rospy's connections from nodes outside the lockstep."""

    def __init__(
        self,
        name: str,
        data_class: Any,
        callback: Any = None,
        callback_args: Any = None,
        **options: Any,
    ) -> None:
        self._kind, self._function, self._arguments = data_class, callback, callback_args
        topic = rospy.resolve_name(name)
        self._connected = is_connected(data_class, topic)
        _exchange().listen(topic, self.receive)
        if self._connected:
            super().__init__(name, data_class, self._hear, **options)
        else:
            self.resolved_name, self.impl = topic, None

    def receive(self, message: LockstepMessage) -> None:
        """Receives a message from a token."""
        own = self._kind()
        own._connection_header = {"callerid": message.sender, "topic": message.topic}
        own.deserialize(message.data)
        self._call(own)

    def _hear(self, message: Any) -> None:
        header = message._connection_header
        latched = header.get("latching") == "1"
        sender = header.get(RELAYED_NODE, header["callerid"])
        if _exchange().accepts(self.resolved_name, sender, latched, lambda: _serialised(message)):
            self._call(message)

    def _call(self, message: Any) -> None:
        if self._arguments is None:
            self._function(message)
        else:
            self._function(message, self._arguments)

    def unregister(self) -> None:
        """Ends the subscription."""
        _exchange().ignore(self.resolved_name, self.receive)
        if self._connected:
            super().unregister()


class _Timer:
    """``rospy.Timer`` without a thread: called by `Exchange.run_timers`."""

    def __init__(
        self,
        period: rospy.Duration,
        callback: Callable[[Any], None],
        oneshot: bool = False,
        reset: bool = False,
    ) -> None:
        del reset  # lockstep time jumps back only if the simulator restarts; run_if_due then resets the due time
        self._period, self._callback, self._oneshot = period, callback, oneshot
        self._due = rospy.Time.now() + period
        self._last: rospy.Time | None = None
        _exchange().timers.append(self)

    def run_if_due(self, now: rospy.Time) -> None:
        """Runs the callback if it is due."""
        if now < self._due:
            if self._due - now > self._period:
                self._due = now + self._period
            return
        due, self._due = self._due, max(self._due + self._period, now)
        self._callback(rospy.timer.TimerEvent(self._last, self._last, due, now, None))
        self._last = now
        if self._oneshot:
            self.shutdown()

    def shutdown(self) -> None:
        """Ends the timer."""
        if self in _exchange().timers:
            _exchange().timers.remove(self)
