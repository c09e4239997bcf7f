"""The contents of a fleet file, which describes a fleet of different robots."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pioneer_node.core.document import DocumentError, built
from pioneer_node.core.parameter import ParameterError

_NAME = re.compile(r"[A-Za-z]\w*")
_POSE = {"x", "y", "a"}


NO_NAVIGATION = "none"
"""Value of ``navigation`` for a robot that another navigation drives, such as Nav2."""


class FleetFileError(ParameterError):
    """The fleet file is invalid."""


@dataclasses.dataclass(frozen=True)
class RobotEntry:
    """One robot of a fleet."""

    name: str = ""  #: its name, namespace and tf prefix
    description: str = ""  #: xacro or URDF file; empty for the Pioneer
    #: start pose: x, y [m] and heading a [rad] in ``map``; empty for the start place that the world defines
    pose: dict[str, float] = dataclasses.field(default_factory=dict)
    navigation: str = ""  #: YAML file of move_base parameters that override those of pioneer_2dnav; empty for none
    #: (``none``: no amcl, move_base and waypoint client)
    laser: str = "base_scan"  #: topic of its laser scans, relative to its namespace


def fleet_from_mapping(content: Any, source: str) -> tuple[RobotEntry, ...]:
    """Returns the robots in a fleet file's content, ``robots: [{name: …, …}, …]``.

    A robot without a name becomes ``pioneerN``, N being its position in the list. ``source`` names the file in errors.

    Raises:
        FleetFileError: the form is wrong, a field is unknown, or two robots have the same name.
    """
    listed = content.get("robots") if isinstance(content, Mapping) else None
    if not isinstance(listed, list) or not listed or set(content) != {"robots"}:
        raise FleetFileError(f"{source}: must be 'robots:' with a list of robots and nothing else")
    robots = tuple(_entry(one, number, source) for number, one in enumerate(listed, 1))
    try:
        check_robots(robots)
    except DocumentError as error:
        raise FleetFileError(f"{source}: {error}") from None
    return robots


def check_robots(robots: Sequence[RobotEntry]) -> None:
    """Checks names and poses.

    Raises:
        DocumentError: a name or pose is invalid, or two robots have the same name.
    """
    names = [robot.name for robot in robots]
    for number, robot in enumerate(robots):
        owner = f"robot {number + 1}"
        if not _NAME.fullmatch(robot.name):
            raise DocumentError(
                f"{owner}: a name has letters, digits and _ and begins with a letter, not {robot.name!r}",
                number,
            )
        if robot.pose and set(robot.pose) != _POSE:
            raise DocumentError(
                f"{owner}: pose must have the numbers x, y and a, not {robot.pose}", number
            )
        if names.count(robot.name) > 1:
            raise DocumentError(f"two robots are called {robot.name}", number)


def _entry(fields: Any, number: int, source: str) -> RobotEntry:
    owner = f"{source}: robot {number}"
    try:
        named = {"name": f"pioneer{number}", **fields} if isinstance(fields, Mapping) else fields
        return built(RobotEntry, named, f"robot {number}")
    except DocumentError as error:
        raise FleetFileError(f"{owner if error.place else source}: {error}") from None
