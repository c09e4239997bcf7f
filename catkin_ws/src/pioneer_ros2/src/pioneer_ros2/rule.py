r"""What crosses between ROS 1 and ROS 2: rules with patterns, from a YAML file.

.. code-block:: yaml

    out:                                   # from ROS 1 to ROS 2; the first rule that matches counts
      - topic: /(\w+)/base_scan            # regular expression for the whole ROS 1 name
        ros2: /\1/scan                     # its name in ROS 2, with groups of the pattern; default: the same
        qos: sensor                        # sensor, reliable (default), latched
        rate: 5                            # at most so many messages a second [Hz]; default: all
        own_frames: true                   # the robot's prefix is taken off the message's frames, as on /{robot}/tf;
                                           # such a topic is one more, and later rules match, too
      - topic: /tf
        ros2: /{robot}/tf                  # one topic for each robot: its transforms, its prefix taken off
    in:                                    # from ROS 2 to ROS 1
      - topic: /(\w+)/cmd_vel              # regular expression for the whole ROS 2 name
        ros1: /\1/pioneer/cmd_vel          # its name in ROS 1; default: the same
        type: geometry_msgs/Twist          # type in ROS 1
        needs_subscriber: false            # also while no node here subscribes, for gateways to carry on
    stop:                                  # topics of ROS 2, std_msgs/Bool: robots are held while the last one was true
      - /estop                             # every robot
      - /{robot}/estop                     # one robot
"""

import difflib
import enum
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from pioneer_ros2.error import RuleError

ROBOT = "{robot}"
"""Stands for a robot's name in topics."""
_TOPIC = re.compile(r"(/[A-Za-z]\w*)+")
_TYPE = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*")


class Qos(enum.Enum):
    """How a topic is offered in ROS 2."""

    SENSOR = "sensor"  #: the newest few messages; nothing waits for a slow reader
    RELIABLE = "reliable"  #: every message, as long as the reader keeps up
    LATCHED = (
        "latched"  #: reliable, and the newest message for readers that come later (transient local)
    )


@dataclass(frozen=True)
class OutRule:
    """Topics that go from ROS 1 to ROS 2. The module's text explains the fields."""

    topic: str
    ros2: str = ""
    qos: Qos = Qos.RELIABLE
    rate: float = 0.0  #: greatest number of messages a second [Hz]; 0: no limit
    own_frames: bool = False


@dataclass(frozen=True)
class InRule:
    """Topics that go from ROS 2 to ROS 1. The module's text explains the fields."""

    topic: str
    type: str
    ros1: str = ""
    qos: Qos = Qos.RELIABLE
    needs_subscriber: bool = True


@dataclass(frozen=True)
class Rules:
    """All rules, in the file's order."""

    out: tuple[OutRule, ...] = ()
    into: tuple[InRule, ...] = ()
    stop: tuple[
        str, ...
    ] = ()  #: topics of ROS 2 that hold robots; with ``{robot}`` for one of each robot


@dataclass(frozen=True)
class Export:
    """One topic of ROS 1 that a rule offers in ROS 2."""

    source: str  #: topic in ROS 1
    name: str  #: topic in ROS 2
    qos: Qos
    rate: float
    robot: str  #: whose transforms are kept, without its prefix; empty: no filter
    own_frames: bool = (
        False  #: whether the prefix of the topic's robot is taken off the message's frames
    )


@dataclass(frozen=True)
class Import:
    """One topic of ROS 2 that a rule brings into ROS 1."""

    name: str  #: topic in ROS 2
    target: str  #: topic in ROS 1
    type: str  #: type in ROS 1
    qos: Qos


def exports(rules: Rules, published: Iterable[str], robots: Iterable[str] = ()) -> list[Export]:
    """Returns what the rules offer of the topics that are ``published`` in ROS 1.

    A rule for single robots adds a topic for each of the ``robots``, and does not keep later rules from matching. Nor
    does a rule with ``own_frames``.
    """
    names = sorted(robots)
    found: dict[str, Export] = {}
    for source in sorted(published):
        for rule in rules.out:
            match = re.fullmatch(rule.topic, source)
            if match is None:
                continue
            if ROBOT in rule.ros2:
                for robot in names:
                    name = rule.ros2.replace(ROBOT, robot)
                    found.setdefault(name, Export(source, name, rule.qos, rule.rate, robot))
                continue
            name = match.expand(rule.ros2) if rule.ros2 else source
            export = Export(source, name, rule.qos, rule.rate, "", rule.own_frames)
            found.setdefault(name, export)
            if not rule.own_frames:
                break
    return list(found.values())


def imports(rules: Rules, subscribed: Iterable[str], offered: Iterable[str]) -> list[Import]:
    """Returns what the rules bring in.

    Args:
        rules: the rules.
        subscribed: topics that have subscribers in ROS 1; ROS 2 sees a subscription for those that keep their names.
        offered: topics that have publishers in ROS 2.
    """
    wanted = set(subscribed)
    found: dict[str, Import] = {}
    for name in sorted(set(offered) | wanted):
        for rule in rules.into:
            match = re.fullmatch(rule.topic, name)
            if match is None:
                continue
            target = match.expand(rule.ros1) if rule.ros1 else name
            if target in wanted or not rule.needs_subscriber:
                found.setdefault(name, Import(name, target, rule.type, rule.qos))
            break
    return list(found.values())


def rules_from_mapping(content: Any) -> Rules:
    """Returns the rules in a YAML document.

    Raises:
        RuleError: an entry, a field or a value that a rule cannot have; the message names it.
    """
    if not isinstance(content, Mapping):
        raise RuleError("the rules must be lists under 'out', 'in' and 'stop'")
    for name in content:
        if name not in ("out", "in", "stop"):
            raise RuleError(f"unknown section '{name}'; there are 'out', 'in' and 'stop'")
    out = [
        _rule(OutRule, entry, f"out, rule {number}") for number, entry in _entries(content, "out")
    ]
    into = [_rule(InRule, entry, f"in, rule {number}") for number, entry in _entries(content, "in")]
    stop = tuple(_stop_topic(entry, number) for number, entry in _entries(content, "stop"))
    return Rules(tuple(out), tuple(into), stop)


def _entries(content: Mapping[str, Any], section: str) -> Iterable[tuple[int, Any]]:
    entries = content.get(section) or []
    if not isinstance(entries, Sequence) or isinstance(entries, str):
        raise RuleError(f"'{section}' must be a list of rules")
    return enumerate(entries, 1)


def _stop_topic(entry: Any, number: int) -> str:
    if not isinstance(entry, str) or not _TOPIC.fullmatch(entry.replace(ROBOT, "robot")):
        raise RuleError(f"stop, rule {number}: must be a topic such as /estop, not {entry!r}")
    return entry


def _rule(kind: Any, entry: Any, where: str) -> Any:
    if not isinstance(entry, Mapping):
        raise RuleError(f"{where}: must have fields such as 'topic', not {entry!r}")
    known = [field.name for field in fields(kind)]
    for name in entry:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, 1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; there are {', '.join(known)}"
            raise RuleError(f"{where}: unknown field '{name}'{hint}")
    values = dict(entry)
    for name in ("topic", "type"):
        if name in known and not isinstance(values.get(name), str):
            raise RuleError(f"{where}: needs '{name}'")
    _check_pattern(values["topic"], where)
    if "type" in values and not _TYPE.fullmatch(values["type"]):
        raise RuleError(f"{where}: type must be package/Name as in ROS 1, not {values['type']!r}")
    if "qos" in values:
        values["qos"] = _qos(values["qos"], where)
    if "rate" in values:
        values["rate"] = _rate(values["rate"], where)
    for name in ("needs_subscriber", "own_frames"):
        if not isinstance(values.get(name, True), bool):
            raise RuleError(f"{where}: {name} must be true or false, not {values[name]!r}")
    for name in ("ros2", "ros1"):
        if not isinstance(values.get(name, ""), str):
            raise RuleError(f"{where}: '{name}' must be text, not {values[name]!r}")
        _check_template(values["topic"], values.get(name, ""), f"{where}: '{name}'")
    return kind(**values)


def _check_pattern(pattern: str, where: str) -> None:
    try:
        re.compile(pattern)
    except re.error as error:
        raise RuleError(
            f"{where}: topic {pattern!r} is not a regular expression: {error}"
        ) from None


def _check_template(pattern: str, template: str, where: str) -> None:
    """Raises RuleError if ``template`` names a group that the pattern does not have."""
    groups = re.compile(pattern).groups
    for number in re.findall(r"\\(\d+)", template):
        if not 1 <= int(number) <= groups:
            raise RuleError(f"{where} has \\{number}, but the topic's pattern has {groups} groups")


def _qos(value: Any, where: str) -> Qos:
    try:
        return Qos(value)
    except ValueError:
        raise RuleError(
            f"{where}: qos must be one of {', '.join(qos.value for qos in Qos)}, not {value!r}"
        ) from None


def _rate(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value < 1.0e6:
        raise RuleError(f"{where}: rate must be above 0 Hz, not {value!r}")
    return float(value)
