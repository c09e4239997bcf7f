"""The node ``ros2_door``: topics of this ROS 1 master in a ROS 2 domain, and topics of that domain in this master."""

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rospkg
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from pioneer_node.adapters.heap import keep_freed_memory
from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.adapters.node_process import NodeProcess
from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes.node_host import leave
from pioneer_ros2.error import DoorError, RuleError, TypeUnknownError
from pioneer_ros2.rule import Export, Import, Rules, exports, imports, rules_from_mapping
from pioneer_ros2.state import State, StateLog
from tcpros.node_context import NodeContext
from tcpros.xmlrpc_client import Server

try:
    from cyclonedds.core import DDSException

    from pioneer_ros2.dds import Participant
    from pioneer_ros2.estop import COMMAND, EmergencyStop
    from pioneer_ros2.message import RELEASES, MessageTypes
    from pioneer_ros2.naming import topic_of, type_of
    from pioneer_ros2.stream import ExportTopic, ImportTopic
except ImportError as error:
    raise SystemExit(
        f"ros2_door: {error}: './pioneer run roslaunch pioneer_ros2 ros2_door.launch' installs what it needs"
    ) from None

_LOOK_PERIOD = 1.0
"""How often the ROS 1 master is asked for new topics [s]: it reports them only to nodes that subscribe."""
_TYPES_EVERY = 5
"""Types are asked for at every so-manieth look even if no registration has changed."""
_JOIN_PERIOD = 2.0
"""How often the door tries to join a domain that it cannot join [s]."""
_SETTLE = 0.05
"""A change in ROS 2 waits so long for further ones: a node that starts makes many at once [s]."""
_OWN_TOPICS = {"/rosout", "/rosout_agg", "/diagnostics"}
_ANY = "*"


@dataclass(frozen=True)
class DoorConfig:
    """Parameters of the node."""

    rules: str = ""  #: path of a YAML file with rules, see ``pioneer_ros2.rule``; empty: ``config/fleet.yaml``
    node_name: str = "pioneer_fleet"  #: the node's name in ROS 2
    release: str = "kilted"  #: release of ROS 2: humble, iron, jazzy or kilted
    #: robots that are held from the start, ``*`` for every robot; the node keeps it, for the one after it
    held: tuple[str, ...] = ()


class DoorNode:
    """Carries what its rules name between a ROS 1 master and a ROS 2 domain.

    Publishes: ``~topics`` (diagnostic_msgs/DiagnosticArray, latched, on change): state and reason of the door and of
        each topic; ``/diagnostics``: the same with counters, once a second while there are subscribers.

    Parameters: the fields of `DoorConfig`, private. Sets ``~held``.

    Environment: ``ROS_DOMAIN_ID``, ``ROS_AUTOMATIC_DISCOVERY_RANGE``, ``ROS_LOCALHOST_ONLY``, ``ROS_STATIC_PEERS`` and
        ``CYCLONEDDS_URI``, as in ROS 2; without the last four only this machine is reached.

    Threads: the node's thread does everything but receive from ROS 2, which Cyclone's threads do.

    On error: rules that cannot be read end the node with one line. Everything else is a state with a reason, in the log
        once: a domain that cannot be joined, a master that does not answer or was restarted, a topic that cannot cross.
    """

    def __init__(self, node: NodeHandle, master: Server) -> None:
        config = config_from_mapping(DoorConfig, node.parameters(), node.name)
        if config.release not in RELEASES:
            known = ", ".join(RELEASES)
            raise DoorError(f"release must be one of {known}, not '{config.release}'")
        self._node = node
        self._master = master
        self._name = config.node_name
        self._rules = _rules_from_file(config.rules)
        self._messages = MessageTypes(config.release, _installed_definition)
        self._domain = _domain_number(os.environ.get("ROS_DOMAIN_ID", "0"))
        self._participant: Participant | None = None
        self._door_problem = "it is starting"
        self._master_problem = ""
        self._was_registered = False
        self._looks = 0
        self._system_state: Any = None
        self._types: dict[str, str] = {}
        self._published: set[str] = set()
        self._subscribed: set[str] = set()
        self._exports: dict[str, ExportTopic] = {}  # by topic in ROS 1
        self._imports: dict[tuple[str, str], ImportTopic] = {}  # by topic and type in ROS 2
        self._import_problems: dict[str, str] = {}  # by topic in ROS 2
        self._announced: tuple[list[bytes], list[bytes]] | None = None
        self._apply_is_due = False
        self._ended = False
        self._held = [str(name) for name in config.held]
        self._is_held_kept = True
        self._stop = EmergencyStop(
            node, self._messages, self._rules.stop, self._held, self._keep_held
        )
        self._log = StateLog()
        self._reported: list[State] = []
        self._topics = node.advertise("~topics", DiagnosticArray, latch=True)
        self._diagnostics = node.advertise("/diagnostics", DiagnosticArray)
        self._join()
        self._look()

    # The domain

    def _join(self) -> None:
        """Joins the domain; tries again later if that fails."""
        if self._ended:
            return
        try:
            self._participant = Participant(self._domain, self._name, self._messages, self._changed)
        except DDSException as problem:
            self._door_problem = f"cannot join the ROS 2 domain {self._domain}: {problem}"
            self._node.call_later(_JOIN_PERIOD, self._join)
            return
        self._door_problem = ""
        count = len(self._rules.out) + len(self._rules.into)
        self._node.logger.info(
            "ROS 2 domain %d is open: rules of %d topic patterns", self._domain, count
        )
        self._apply()

    def _changed(self) -> None:
        """Takes up that endpoints in ROS 2 have changed; called in a thread of Cyclone."""
        self._node.call(self._apply_soon)

    def _apply_soon(self) -> None:
        if not self._apply_is_due:
            self._apply_is_due = True
            self._node.call_later(_SETTLE, self._apply)

    # The master

    def _look(self) -> None:
        """Asks the master for topics, once a period."""
        if self._ended:
            return
        self._node.call_later(_LOOK_PERIOD, self._look)
        self._ask_master("getSystemState", self._take_state)
        self._report()

    def _ask_master(self, method: str, done: Any) -> None:
        self._master.call(method, (self._node.name,), done, self._no_master)

    def _no_master(self, reason: str) -> None:
        self._master_problem = f"the ROS 1 master does not answer: {reason}"

    def _take_state(self, state: Any) -> None:
        self._master_problem = ""
        self._looks += 1
        if not self._is_held_kept:
            self._write_held()
        if state == self._system_state and self._looks % _TYPES_EVERY:
            self._apply()
            return
        self._system_state = state
        publishers, subscribers, _ = state
        self._check_registration(publishers)
        self._published = self._others(publishers)
        self._subscribed = self._others(subscribers)
        self._ask_master("getTopicTypes", self._take_types)

    def _check_registration(self, publishers: list[tuple[str, list[str]]]) -> None:
        """Registers again if the master has forgotten this node.

        It is known by the topic that it has from its start to its end: a call that was on its way when the master was
        restarted registers another one at the new master.
        """
        lasting = self._node.resolved("~topics")
        is_registered = any(
            topic == lasting and self._node.name in nodes for topic, nodes in publishers
        )
        if self._was_registered and not is_registered:
            self._node.logger.warning("the ROS 1 master was restarted; registering again")
            self._node.register_again()
            self._is_held_kept = False
        self._was_registered |= is_registered

    def _others(self, rows: list[tuple[str, list[str]]]) -> set[str]:
        """Returns the topics that other nodes have."""
        own = {self._node.name}
        return {topic for topic, nodes in rows if set(nodes) - own and topic not in _OWN_TOPICS}

    def _take_types(self, types: list[tuple[str, str]]) -> None:
        self._types = dict(types)
        self._apply()

    # Topics

    def _apply(self) -> None:
        """Opens and closes topics as the rules and both sides need them."""
        self._apply_is_due = False
        if self._ended:
            return
        self._stop.update(self._commanded_robots(), self._participant)
        if self._participant is None:
            return
        self._keep_exports(self._participant)
        self._keep_imports(self._participant)
        for topic in self._all_topics():
            topic.update()
        self._announce(self._participant)

    def _commanded_robots(self) -> set[str]:
        """Returns the robots whose simulator or driver takes velocities on this master."""
        end = f"/{COMMAND}"
        return {topic[1 : -len(end)] for topic in self._subscribed if topic.endswith(end)}

    def _keep_held(self, held: list[str]) -> None:
        """Applies what is held, and stores it: a node that takes the place of this one holds it again."""
        self._mute_held()
        self._held = held
        self._write_held()

    def _write_held(self) -> None:
        """Stores what is held; until the master has it, each look stores it again."""
        self._is_held_kept = False
        held = self._held

        def done(_: Any) -> None:
            self._is_held_kept = held is self._held

        name = self._node.resolved("~held")
        self._master.call("setParam", (self._node.name, name, held), done, self._no_master)

    def _all_topics(self) -> list[ExportTopic | ImportTopic]:
        return [*self._exports.values(), *self._imports.values()]

    def _keep_exports(self, participant: Participant) -> None:
        robots = {
            topic.split("/")[1]
            for topic in self._published
            if topic.endswith("/odom") and topic.count("/") == 2
        }
        by_source: dict[str, list[Export]] = {}
        for export in exports(self._rules, self._published, robots):
            if export.source in self._stop.guarded:
                # The stop subscribes to it itself, and a node has one subscription of a topic.
                continue
            if self._types.get(export.source, _ANY) != _ANY:
                by_source.setdefault(export.source, []).append(export)
        for source in self._exports.keys() - by_source.keys():
            self._exports.pop(source).close()
        for source, found in by_source.items():
            type_name = self._types[source]
            topic = self._exports.get(source)
            if topic is not None and topic.type_name != type_name:
                # The publisher came back with another type.
                topic.close()
                topic = None
            if topic is None:
                topic = ExportTopic(self._node, source, type_name)
                self._exports[source] = topic
            topic.offer(found, participant, self._messages)

    def _keep_imports(self, participant: Participant) -> None:
        by_topic = _types_by_topic(participant.offered())
        needed: dict[tuple[str, str], Import] = {}
        for rule in imports(self._rules, self._subscribed, by_topic):
            # A publisher that was killed stays known for some seconds, beside one that came back with another type.
            for type_name in by_topic.get(rule.name) or {rule.type}:
                needed[rule.name, type_name] = rule
        for key in self._imports.keys() - needed.keys():
            self._imports.pop(key).close()
        problems: dict[str, str] = {}
        for (name, type_name), rule in needed.items():
            if (name, type_name) in self._imports:
                continue
            try:
                self._imports[name, type_name] = ImportTopic(
                    self._node, rule, type_name, participant, self._messages
                )
            except TypeUnknownError as problem:
                problems[name] = str(problem)
        self._import_problems = problems
        self._mute_held()

    def _mute_held(self) -> None:
        """Keeps velocities from ROS 2 from robots that are held."""
        for topic in self._imports.values():
            topic.is_held = topic.rule.target in self._stop.guarded

    def _announce(self, participant: Participant) -> None:
        """Announces the node's readers and writers in ROS 2 if they have changed."""
        outlets = [outlet for topic in self._exports.values() for outlet in topic.outlets.values()]
        imported = [topic.reader for topic in self._imports.values()]
        readers = sorted(reader.guid for reader in [*imported, *self._stop.readers])
        writers = sorted(outlet.writer.guid for outlet in outlets)
        if (readers, writers) != self._announced:
            participant.announce(readers, writers)
            self._announced = (readers, writers)

    # Reports

    def _states(self) -> Iterator[State]:
        yield self._own_state()
        held = self._stop.state()
        if held is not None:
            yield held
        if self._participant is None:
            return
        requested = _types_by_topic(self._participant.requested())
        for _, export in sorted(self._exports.items()):
            yield from export.states(requested)
        for _, stream in sorted(self._imports.items()):
            yield stream.state()
        for name, text in sorted(self._import_problems.items()):
            yield State(f"{name} from ROS 2", f"it does not cross: {text}", False)

    def _own_state(self) -> State:
        problem = self._door_problem or self._master_problem
        if problem:
            return State("door", problem, False)
        return State("door", f"ROS 2 domain {self._domain} is open")

    def _report(self) -> None:
        """Logs and publishes the states."""
        states = list(self._states())
        for state in self._log.changes(states):
            level = self._node.logger.info if state.is_ok else self._node.logger.warning
            level("%s: %s", state.name, state.text)
        plain = [state._replace(values=()) for state in states]
        if plain != self._reported:
            self._reported = plain
            self._topics.publish(self._array(plain))
        if self._diagnostics.has_subscribers:
            self._diagnostics.publish(self._array(states))

    def _array(self, states: list[State]) -> DiagnosticArray:
        array = DiagnosticArray()
        array.header.stamp = self._node.stamp()
        for state in states:
            level = DiagnosticStatus.OK if state.is_ok else DiagnosticStatus.WARN
            values = [KeyValue(key, value) for key, value in state.values]
            name = f"ros2_door: {state.name}"
            array.status.append(DiagnosticStatus(level, name, state.text, "", values))
        return array

    def end(self, done: Any) -> None:
        """Leaves both sides, so that peers need not wait for a time-out."""
        self._ended = True
        self._stop.close()
        for topic in self._all_topics():
            topic.close()
        if self._participant is not None:
            self._participant.close()
        done()


def _types_by_topic(endpoints: dict[str, set[str]]) -> dict[str, set[str]]:
    """Returns message types by topic of ROS 2, of endpoints with DDS names; what is no topic of ROS is left out."""
    found: dict[str, set[str]] = {}
    for dds_name, dds_types in endpoints.items():
        topic = topic_of(dds_name)
        if topic is None:
            continue
        types = {type_name for dds_type in dds_types if (type_name := type_of(dds_type))}
        if types:
            found[topic] = types
    return found


def _installed_definition(type_name: str) -> str:
    """Returns the definition of a type that is installed here; empty if it is not."""
    import roslib.message

    known = roslib.message.get_message_class(type_name)
    return known._full_text if known else ""


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
    """Entry point of the executable ``ros2_door``."""
    keep_freed_memory()
    process = NodeProcess(sys.argv, (DoorError,), wall_time=True)
    context: NodeContext = process.context
    name = process.own_name("ros2_door")
    if not process.add(name, lambda node: DoorNode(node, context.master)):
        process.fail()
    leave(process.run())
