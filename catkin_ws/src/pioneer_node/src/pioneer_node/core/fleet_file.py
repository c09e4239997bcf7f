"""A fleet of different robots, as a file describes it."""

import dataclasses
import difflib
import re
from collections.abc import Mapping
from typing import Any

from pioneer_node.core.parameter import ParameterError, config_from_mapping

_NAME = re.compile(r"[A-Za-z]\w*")
_POSE = {"x", "y", "a"}


class FleetFileError(ParameterError):
    """A fleet file that cannot be used."""


@dataclasses.dataclass(frozen=True)
class RobotEntry:
    """One robot of a fleet.

    Attributes:
        name: its name, namespace and tf prefix.
        description: xacro or URDF file; empty for the Pioneer.
        pose: where it starts: x, y [m] and heading a [rad] in ``map``; empty for its place of the world's.
        navigation: YAML file of move_base parameters that replace those of pioneer_2dnav; empty for none.
        laser: topic of its scans, in its namespace.
    """

    name: str = ""
    description: str = ""
    pose: dict[str, float] = dataclasses.field(default_factory=dict)
    navigation: str = ""
    laser: str = "base_scan"


_FIELDS = {field.name for field in dataclasses.fields(RobotEntry)}


def fleet_from_mapping(content: Any, source: str) -> tuple[RobotEntry, ...]:
    """Returns the robots of a fleet file's content, ``robots: [{name: …, …}, …]``.

    A robot without a name is ``pioneerN``, N being its place in the list. ``source`` names the file in errors.

    Raises:
        FleetFileError: it is not of this form, has an unknown field, or two robots have one name.
    """
    listed = content.get("robots") if isinstance(content, Mapping) else None
    if not isinstance(listed, list) or not listed or set(content) != {"robots"}:
        raise FleetFileError(f"{source}: must be 'robots:' with a list of robots and nothing else")
    robots = tuple(_entry(one, number, source) for number, one in enumerate(listed, 1))
    names = [robot.name for robot in robots]
    for name in names:
        if names.count(name) > 1:
            raise FleetFileError(f"{source}: two robots are called {name}")
    return robots


def _entry(fields: Any, number: int, source: str) -> RobotEntry:
    owner = f"{source}: robot {number}"
    if not isinstance(fields, Mapping):
        raise FleetFileError(f"{owner} must be a mapping such as {{name: pioneer1}}, not {fields!r}")
    for field in set(fields) - _FIELDS:
        near = difflib.get_close_matches(str(field), _FIELDS, 1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(_FIELDS))}"
        raise FleetFileError(f"{owner}: unknown field {field}; {hint}")
    try:
        robot = config_from_mapping(RobotEntry, {"name": f"pioneer{number}", **fields}, owner)
    except ParameterError as error:
        raise FleetFileError(str(error).replace("parameter ~", "field ")) from None
    if not _NAME.fullmatch(robot.name):
        raise FleetFileError(f"{owner}: a name has letters, digits and _ and begins with a letter, not {robot.name!r}")
    if robot.pose and (
        set(robot.pose) != _POSE or not all(isinstance(one, int | float) for one in robot.pose.values())
    ):
        raise FleetFileError(f"{owner}: pose must have the numbers x, y and a, not {robot.pose}")
    return robot
