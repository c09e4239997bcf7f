"""The node ``ros2_door``: topics of this ROS 1 master in a ROS 2 domain, and topics of that domain in this master."""

import os
import socket
import threading
import xmlrpc.client
from pathlib import Path
from typing import Any

import rosgraph
import rospkg
import rospy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from pioneer_node.nodes import entry
from pioneer_ros2.error import DoorError, RuleError, TypeUnknownError
from pioneer_ros2.rule import Export, Import, Rules, exports, imports, rules_from_mapping

try:
    from cyclonedds.core import DDSException

    from pioneer_ros2.dds import Participant, Writer
    from pioneer_ros2.message import MessageTypes
    from pioneer_ros2.naming import topic_of, type_of
    from pioneer_ros2.stream import TF, ExportStream, ImportStream
except ImportError as error:
    raise SystemExit(
        f"ros2_door: {error}: './pioneer run roslaunch pioneer_ros2 ros2_door.launch' installs what it needs"
    ) from None

_LOOK_PERIOD = 1.0
"""How often the ROS 1 master is asked for new topics [s]: it reports them only to nodes that subscribe."""
_MASTER_ERRORS = (OSError, rosgraph.MasterException, xmlrpc.client.Error, socket.error)
_OWN_TOPICS = {"/rosout", "/rosout_agg", "/diagnostics"}


class DoorNode:
    """Carries what its rules name between a ROS 1 master and a ROS 2 domain.

    Publishes: ``/diagnostics`` (diagnostic_msgs/DiagnosticArray): a status for each topic that crosses, once a second.

    Parameters: ``~rules`` (path of a YAML file, see ``pioneer_ros2.rule``; default: ``config/fleet.yaml``),
        ``~node_name`` (the node's name in ROS 2, "pioneer_fleet").

    Environment: ``ROS_DOMAIN_ID``, ``ROS_AUTOMATIC_DISCOVERY_RANGE``, ``ROS_LOCALHOST_ONLY``, ``ROS_STATIC_PEERS`` and
        ``CYCLONEDDS_URI``, as in ROS 2; without the last four only this machine is reached.

    Threads: rospy's and Cyclone's threads carry messages; one loop looks for topics, and wakes when endpoints match.

    On error: rules that cannot be read, or a domain that cannot be joined, end the node with one line. A topic that
        cannot cross is named once in the log and in ``/diagnostics``; the others cross.
    """

    def __init__(self) -> None:
        self._rules = _rules_from_file(rospy.get_param("~rules", ""))
        self._wake = threading.Event()
        self._messages = MessageTypes()
        domain = _domain_number(os.environ.get("ROS_DOMAIN_ID", "0"))
        name = str(rospy.get_param("~node_name", "pioneer_fleet"))
        try:
            self._participant = Participant(domain, name, self._messages, self._wake.set)
        except DDSException as problem:
            raise DoorError(f"cannot join the ROS 2 domain {domain}: {problem}") from None
        self._exports: dict[str, ExportStream] = {}
        self._imports: dict[tuple[str, str], ImportStream] = {}  # by topic and type in ROS 2
        self._problems: dict[str, str] = {}
        self._announced: tuple[list[bytes], list[bytes]] | None = None
        self._master = rosgraph.Master(rospy.get_name())
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=1)
        entry.on_shutdown(self._wake.set)
        rospy.loginfo(
            "ROS 2 domain %d is open: rules of %d topic patterns", domain, _count(self._rules)
        )

    def spin(self) -> None:
        """Keeps the streams as the rules and both sides need them, until shutdown."""
        while not rospy.is_shutdown():
            self._look()
            self._report()
            self._wake.wait(_LOOK_PERIOD)
            self._wake.clear()
        for stream in self._streams():
            stream.close()
        self._participant.close()

    def _streams(self) -> list[ExportStream | ImportStream]:
        return [*self._exports.values(), *self._imports.values()]

    def _look(self) -> None:
        """Opens and closes streams."""
        try:
            publishers, subscribers, _ = self._master.getSystemState()
            types = dict(self._master.getTopicTypes())
        except _MASTER_ERRORS as problem:
            rospy.logwarn_throttle(30.0, f"the ROS 1 master does not answer: {problem}")
            return
        own = rospy.get_name()
        published = {
            topic for topic, nodes in publishers if set(nodes) - {own} and topic not in _OWN_TOPICS
        }
        subscribed = {
            topic for topic, nodes in subscribers if set(nodes) - {own} and topic not in _OWN_TOPICS
        }
        self._keep_exports(published, types)
        self._keep_imports(subscribed)
        for stream in self._streams():
            stream.update()
        self._announce()

    def _keep_exports(self, published: set[str], types: dict[str, str]) -> None:
        robots = {
            topic.split("/")[1]
            for topic in published
            if topic.endswith("/odom") and topic.count("/") == 2
        }
        wanted = {export.name: export for export in exports(self._rules, published, robots)}
        for name in self._exports.keys() - wanted.keys():
            self._exports.pop(name).close()
        for name, export in wanted.items():
            stream = self._exports.get(name)
            type_name = types.get(export.source, "*")
            if stream and stream.writer.converter.type_name not in (type_name, "*"):
                # The publisher came back with another type.
                self._exports.pop(name).close()
                stream = None
            if stream is None and type_name != "*":
                self._open_export(export, type_name)

    def _open_export(self, export: Export, type_name: str) -> None:
        try:
            if export.robot and type_name != TF:
                raise TypeUnknownError(f"'{{robot}}' is for {TF}, not for {type_name}")
            converter = self._messages.converter(type_name, _definition(type_name))
            writer = Writer(self._participant, export.name, converter, export.qos)
            self._exports[export.name] = ExportStream(export, writer)
        except (TypeUnknownError, DDSException) as problem:
            self._complain(export.name, f"{export.source} does not cross to ROS 2: {problem}")
            return
        self._problems.pop(export.name, None)

    def _keep_imports(self, subscribed: set[str]) -> None:
        offered = self._participant.offered()
        by_topic = {topic: kinds for name, kinds in offered.items() if (topic := topic_of(name))}
        wanted: dict[tuple[str, str], Import] = {}
        for each in imports(self._rules, subscribed, by_topic):
            for kind in _offered_types(each, by_topic.get(each.name, set())):
                wanted[each.name, kind] = each
        for key in self._imports.keys() - wanted.keys():
            self._imports.pop(key).close()
        for (name, kind), each in wanted.items():
            if (name, kind) not in self._imports:
                self._open_import(each, kind)

    def _open_import(self, wanted: Import, offered: str) -> None:
        try:
            stream = ImportStream(wanted, offered, self._participant, self._messages)
        except (TypeUnknownError, DDSException) as problem:
            self._complain(wanted.name, f"{wanted.name} does not cross to ROS 1: {problem}")
            return
        self._imports[wanted.name, offered] = stream
        self._problems.pop(wanted.name, None)

    def _complain(self, name: str, text: str) -> None:
        if self._problems.get(name) != text:
            self._problems[name] = text
            rospy.logwarn("%s", text)

    def _announce(self) -> None:
        readers = sorted(stream.reader.guid for stream in self._imports.values())
        writers = sorted(stream.writer.guid for stream in self._exports.values())
        if (readers, writers) != self._announced:
            self._participant.announce(readers, writers)
            self._announced = (readers, writers)

    def _report(self) -> None:
        if not self._diagnostics.get_num_connections():
            return
        report = DiagnosticArray()
        report.header.stamp = rospy.Time.now()
        for name, export in sorted(self._exports.items()):
            state = "active" if export.is_subscribed else "no reader in ROS 2"
            report.status.append(
                _status(f"{export.export.source} to ROS 2 as {name}", state, export)
            )
        for (name, _), stream in sorted(self._imports.items()):
            state = "active" if stream.is_published else "no publisher in ROS 2"
            report.status.append(
                _status(f"{name} from ROS 2 as {stream.wanted.target}", state, stream)
            )
        for name, text in sorted(self._problems.items()):
            report.status.append(
                DiagnosticStatus(DiagnosticStatus.WARN, f"ros2_door: {name}", text, "", [])
            )
        self._diagnostics.publish(report)


def _status(name: str, state: str, stream: Any) -> DiagnosticStatus:
    counter = stream.counter
    values = [KeyValue("messages", str(counter.crossed))]
    level = DiagnosticStatus.OK
    if counter.unreadable:
        values.append(KeyValue("unreadable", str(counter.unreadable)))
        state = f"{state}; {counter.unreadable} messages cannot be read: {counter.complaint}"
        level = DiagnosticStatus.WARN
    return DiagnosticStatus(level, f"ros2_door: {name}", state, "", values)


def _offered_types(wanted: Import, kinds: set[str]) -> list[str]:
    """Returns the types under which ROS 2 sends a topic; the rule's own if none is known.

    A publisher that was killed stays known for some seconds, beside one that came back with another type.
    """
    names = [type_of(kind) for kind in sorted(kinds)]
    return [name for name in names if name] or [wanted.type]


def _definition(type_name: str) -> str:
    """Returns the definition of a type that is installed here; empty if it is not."""
    import roslib.message

    known = roslib.message.get_message_class(type_name)
    return known._full_text if known else ""


def _count(rules: Rules) -> int:
    return len(rules.out) + len(rules.into)


def _domain_number(text: str) -> int:
    """Returns the domain in ``ROS_DOMAIN_ID``.

    Raises:
        DoorError: it is no number from 0 to 232.
    """
    if not text.isdecimal() or int(text) > 232:
        raise DoorError(f"ROS_DOMAIN_ID must be a number from 0 to 232, not {text!r}")
    return int(text)


def _rules_from_file(name: str) -> Rules:
    """Returns the rules in the file, or those of a fleet.

    Raises:
        RuleError: the file cannot be read, or a rule in it; the message names file and rule.
    """
    path = (
        Path(name)
        if name
        else Path(rospkg.RosPack().get_path("pioneer_ros2"), "config", "fleet.yaml")
    )
    try:
        return rules_from_mapping(yaml.safe_load(path.read_text()))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as problem:
        raise RuleError(f"cannot read the rules {path}: {' '.join(str(problem).split())}") from None
    except RuleError as problem:
        raise RuleError(f"{path}: {problem}") from None


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("ros2_door", DoorNode, expected=(DoorError,), wall_time=True)
