"""The interface of a robot's devices to ROS: names, frames, topics, schedule, and the simulation."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any

import rospy
from std_msgs.msg import UInt32

from pioneer_gazebo.error import TopicError
from pioneer_gazebo.ros.topic import (
    SilentTopic,
    Topic,
    TransformTopic,
    check_type,
    publish_while_alive,
)
from pioneer_gazebo.sensors.tiny_renderer import TinyRenderer
from pioneer_gazebo.simulation.command import Moment
from pioneer_gazebo.simulation.drive import CommandError
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import RateError, Schedule, Task, nanoseconds, nearest_rate
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import Budget
from pioneer_node.core.frame import resolved
from pioneer_node.nodes.standing_warning import StandingWarning


@dataclass(frozen=True, slots=True)
class Context:
    """Data shared by all robots."""

    simulation: Simulation  #: the simulation
    schedule: Schedule  #: schedule of periodic tasks
    transforms: TransformTopic  #: ``/tf``
    now: Callable[[], Moment]  #: returns the time at which a command arrives; thread-safe
    renderer: Callable[[], TinyRenderer]  #: returns the renderer, created on first use
    budget: Budget  #: wall time budget for rendering


class Port:
    """One robot's connection to ROS; `close` removes everything created through it.

    Parameters: ``tf_prefix`` in the robot's namespace or above, read once.
    """

    def __init__(self, context: Context, entity: Entity) -> None:
        #: simulation: the shared simulation
        #: entity: the robot
        #: context: data shared by all robots
        self.context, self.entity, self.simulation = context, entity, context.simulation
        self.on_reset: list[Callable[[], None]] = []  #: called when simulated time restarts
        self._collisions: rospy.Publisher | None = None
        self._has_collisions = False  # whether the topic was advertised, or warned about
        self._enter(entity.namespace)
        self._tasks: list[Task] = []
        self._topics: list[Topic] = []
        self._connections: list[rospy.Publisher | rospy.Subscriber] = []

    def _enter(self, namespace: str) -> None:
        self._base = f"/{namespace}" if namespace else ""
        self._prefix = _tf_prefix(self._base)

    def within(self, namespace: str | None) -> "Port":
        """Returns this port with another namespace, for a plugin that has its own; None for the robot's.

        What is created through either is closed with this one.
        """
        if namespace is None or namespace == self.entity.namespace:
            return self
        other = copy(self)
        other._enter(namespace)
        return other

    def name(self, name: str) -> str:
        """Returns the full name of a topic in the namespace."""
        return name if name.startswith("/") else f"{self._base}/{name}"

    def frame(self, frame: str) -> str:
        """Returns a frame id with the robot's tf prefix."""
        return resolved(self._prefix, frame)

    def topic(self, name: str, message_class: type) -> Topic:
        """Advertises a topic of serialised frames; a silent one, with a warning, if it has another type already."""
        topic: Topic
        try:
            topic = Topic(self.name(name), message_class, self.context.schedule.review)
        except TopicError as error:
            rospy.logwarn("%s: %s", self.entity.name, error)
            topic = SilentTopic()
        self._topics.append(topic)
        return topic

    def latched(self, name: str, message: Any) -> rospy.Publisher | None:
        """Advertises a latched topic with its first message; None, with a warning, if it has another type already."""
        try:
            check_type(self.name(name), type(message))
        except TopicError as error:
            rospy.logwarn("%s: %s", self.entity.name, error)
            return None
        publisher = rospy.Publisher(self.name(name), type(message), latch=True, queue_size=1)
        self._connections.append(publisher)
        publish_while_alive(publisher, message)
        return publisher

    def take_commands(self, name: str, message_class: type, take: Callable[[Any], None]) -> None:
        """Subscribes to a command topic with queue size 1. ``take`` may raise ``CommandError``."""
        refusing = StandingWarning(f"{self.entity.name}: commands are valid again")

        def callback(message: Any) -> None:
            try:
                take(message)
                refusing.end()
            except CommandError as error:
                refusing.warn(f"{self.entity.name}: {error}; the last command holds")

        self._connections.append(
            rospy.Subscriber(
                self.name(name), message_class, callback, queue_size=1, tcp_nodelay=True
            )
        )

    def every(
        self,
        rate: float,
        what: str,
        action: Callable[[int], None],
        *topics: Topic,
        transforms: bool = False,
        always: bool = False,
    ) -> None:
        """Runs ``action`` while any of ``topics``, or ``/tf``, has subscribers.

        Args:
            rate: [Hz]; 0: every physics step.
            what: name in messages.
            action: called with the tick.
            topics: those it publishes.
            transforms: whether it also publishes transforms.
            always: whether it also runs without subscribers.

        A rate that does not divide the tick rate is replaced by the nearest one that does, with a warning.
        """

        def wanted() -> bool:
            return (
                always
                or any(one.wanted for one in topics)
                or (transforms and self.context.transforms.wanted)
            )

        rate = rate if rate > 0 else 1.0 / self.simulation.physics.step
        owner = f"{self.entity.name}: {what}"
        try:
            task = self.context.schedule.add(owner, rate, action, wanted)
        except RateError:
            possible = nearest_rate(rate)
            rospy.logwarn("%s: %.6g Hz in place of %.6g Hz", owner, possible, rate)
            task = self.context.schedule.add(owner, possible, action, wanted)
        self._tasks.append(task)

    def stream(
        self, name: str, message_class: type, rate: float, frame: Callable[[int], bytes | bytearray]
    ) -> None:
        """Publishes a topic at ``rate`` [Hz] while it has subscribers; ``frame`` makes the frame for a time [ns]."""
        topic = self.topic(name, message_class)
        self.every(rate, name, lambda tick: topic.send(frame(nanoseconds(tick))), topic)

    def publish_collisions(self) -> None:
        """Publishes on ``collisions`` (std_msgs/UInt32, latched) how many there were since the robot was spawned."""
        count = UInt32(self.entity.collisions.count)
        if not self._has_collisions:
            self._has_collisions = True
            self._collisions = self.latched("collisions", count)
        elif self._collisions is not None:
            publish_while_alive(self._collisions, count)

    def reset(self) -> None:
        """Resets devices whose state depends on time, and republishes the collision count."""
        for restart in self.on_reset:
            restart()
        self.publish_collisions()

    def close(self) -> None:
        """Removes tasks, topics and subscriptions."""
        for task in self._tasks:
            self.context.schedule.remove(task)
        for topic in self._topics:
            topic.close()
        for connection in self._connections:
            connection.unregister()


def _tf_prefix(base: str) -> str:
    """Returns ``tf_prefix`` from the namespace ``base`` or the nearest one above it."""
    while True:
        value = rospy.get_param(f"{base}/tf_prefix", None)
        if value is not None:
            return str(value)
        if not base:
            return ""
        base = base.rpartition("/")[0]
