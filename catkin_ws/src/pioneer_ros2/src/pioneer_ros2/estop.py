"""Emergency stop from ROS 2: robots are held still while a std_msgs/Bool was last true, as by the command ``ESTOP``."""

from collections.abc import Callable, Iterable

from pioneer_node.adapters.node_handle import NodeHandle, Publisher, Subscriber
from pioneer_ros2.dds import Participant, Reader
from pioneer_ros2.message import MessageTypes
from pioneer_ros2.rule import ROBOT, Qos
from pioneer_ros2.state import State
from pioneer_ros2.transcoder import MalformedError

COMMAND = "pioneer/cmd_vel"
"""Topic of a robot's velocity commands."""
ALL = "*"
"""Stands for every robot, present and future."""
ZERO_PERIOD = 0.05
"""Interval between zero velocities to a held robot [s of wall time]."""
CANCEL_PERIOD = 1.0
"""Interval at which the goals of held robots are cancelled again: nodes may send new ones [s of wall time]."""
_BOOL = "std_msgs/Bool"
_TWIST = "geometry_msgs/Twist"
_ZERO_TWIST = bytes(48)
_CANCELS = {"map_goal_client/cancel": "std_msgs/Empty", "move_base/cancel": "actionlib_msgs/GoalID"}
_CANCEL_MESSAGES = {"std_msgs/Empty": b"", "actionlib_msgs/GoalID": bytes(12)}
"""By type: a GoalID without time and name means all goals."""


class HeldRobots:
    """Which robots are held, by which topic: a robot is free once every topic that held it releases it."""

    def __init__(self, holders: Iterable[str] = ()) -> None:
        self._holders = set(holders)  # robots, or ALL

    def put(self, robot: str, is_held: bool) -> bool:
        """Holds or releases a robot, or ``ALL``; returns whether that changes anything."""
        before = set(self._holders)
        if is_held:
            self._holders.add(robot)
        else:
            self._holders.discard(robot)
        return self._holders != before

    def holds(self, robot: str) -> bool:
        """Returns whether a robot is held."""
        return ALL in self._holders or robot in self._holders

    @property
    def entries(self) -> list[str]:
        """What is held: names of robots, ``ALL`` for every robot."""
        return sorted(self._holders)


class _HeldRobot:
    """Zero velocities and cancelled goals for one robot; ends with `close`."""

    def __init__(self, node: NodeHandle, robot: str, messages: MessageTypes) -> None:
        twist = messages.ros1_kind(_TWIST)
        topic = f"/{robot}/{COMMAND}"
        self._own_name = node.name
        self._velocity = node.advertise(topic, twist)
        self._guard: Subscriber = node.subscribe_serialised(topic, twist, self._on_command)
        self._cancels: list[tuple[Publisher, bytes]] = []
        for name, type_name in _CANCELS.items():
            publisher = node.advertise(f"/{robot}/{name}", messages.ros1_kind(type_name))
            self._cancels.append((publisher, _CANCEL_MESSAGES[type_name]))

    def stop(self) -> None:
        """Commands zero velocity."""
        _send(self._velocity, _ZERO_TWIST)

    def cancel(self) -> None:
        """Clears the waypoints and cancels the goal."""
        for publisher, message in self._cancels:
            _send(publisher, message)

    def _on_command(self, data: bytes | memoryview, sender: str) -> None:
        """Answers another node's motion command with a zero at once."""
        if sender != self._own_name and data != _ZERO_TWIST:
            self.stop()

    def close(self) -> None:
        """Releases the robot."""
        self._guard.close()
        self._velocity.close()
        for publisher, _ in self._cancels:
            publisher.close()


class EmergencyStop:
    """Reads the stop topics of ROS 2 and holds robots.

    Args:
        node: the door's node.
        messages: definitions of types.
        topics: the topics, with ``{robot}`` for a topic of each robot.
        held: what is held from the start, names of robots or ``ALL``.
        changed: called with what is held from now on.
    """

    def __init__(
        self,
        node: NodeHandle,
        messages: MessageTypes,
        topics: Iterable[str],
        held: Iterable[str],
        changed: Callable[[list[str]], None],
    ) -> None:
        self._node = node
        self._messages = messages
        self._topics = tuple(topics)
        self._held = HeldRobots(held)
        self._changed = changed
        self._robots: set[str] = set()
        self._stopped: dict[str, _HeldRobot] = {}
        self._readers: dict[str, Reader] = {}  # by topic
        self._zeros = node.every(ZERO_PERIOD, self._stop)
        self._cancels = node.every(CANCEL_PERIOD, self._cancel)
        self._bool = messages.converter(_BOOL)
        self._complaint = ""

    @property
    def readers(self) -> list[Reader]:
        """The readers of the stop topics."""
        return list(self._readers.values())

    @property
    def guarded(self) -> set[str]:
        """The velocity topics, in ROS 1, of robots that are held."""
        return {f"/{robot}/{COMMAND}" for robot in self._stopped}

    def update(self, robots: set[str], participant: Participant | None) -> None:
        """Takes up which robots there are, and reads their topics."""
        self._robots = robots
        wanted: dict[str, str] = {}
        for topic in self._topics:
            if ROBOT not in topic:
                wanted[topic] = ALL
                continue
            for robot in robots:
                wanted[topic.replace(ROBOT, robot)] = robot
        for topic in self._readers.keys() - wanted.keys():
            self._readers.pop(topic).close()
        if participant is not None:
            for topic in wanted.keys() - self._readers.keys():
                self._readers[topic] = self._reader(participant, topic, wanted[topic])
        self._apply()

    def _reader(self, participant: Participant, topic: str, robot: str) -> Reader:
        def receive(cdr: bytes) -> None:
            # In a thread of Cyclone.
            self._node.call(lambda: self._take(robot, cdr))

        return Reader(participant, topic, self._bool, Qos.RELIABLE, receive)

    def _take(self, robot: str, cdr: bytes) -> None:
        try:
            is_held = self._bool.to_ros1(cdr) != b"\0"
        except (MalformedError, IndexError) as error:
            # Who sends anything here means to stop.
            self._complaint = f"; a message cannot be read and counts as true: {error}"
            is_held = True
        if not self._held.put(robot, is_held):
            return
        whose = "every robot" if robot == ALL else robot
        self._node.logger.warning("ROS 2 %s %s", "holds" if is_held else "releases", whose)
        self._apply()
        self._changed(self._held.entries)

    def _apply(self) -> None:
        held = {robot for robot in self._robots if self._held.holds(robot)}
        for robot in self._stopped.keys() - held:
            self._stopped.pop(robot).close()
        for robot in held - self._stopped.keys():
            self._stopped[robot] = _HeldRobot(self._node, robot, self._messages)
        if self._stopped:
            self._stop()
            self._cancel()
            self._zeros.start()
            self._cancels.start()
        else:
            self._zeros.stop()
            self._cancels.stop()

    def _stop(self) -> None:
        for robot in self._stopped.values():
            robot.stop()

    def _cancel(self) -> None:
        for robot in self._stopped.values():
            robot.cancel()

    def state(self) -> State | None:
        """Returns what is held; None if nothing is."""
        if not self._held.entries:
            return None
        names = "every robot" if ALL in self._held.entries else ", ".join(self._held.entries)
        return State("emergency stop", f"ROS 2 holds {names}{self._complaint}", False)

    def close(self) -> None:
        """Ends both sides; robots that are held are free afterwards."""
        self._zeros.stop()
        self._cancels.stop()
        for reader in self._readers.values():
            reader.close()
        self._readers.clear()
        for robot in self._stopped.values():
            robot.close()
        self._stopped.clear()


def _send(publisher: Publisher, message: bytes) -> None:
    publisher.send(len(message).to_bytes(4, "little") + message)
