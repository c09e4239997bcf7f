"""Whether a fleet can keep the right of way in its world, from the files that describe both."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pioneer_demo.scenario.world_folder import poses_of
from pioneer_node.core.fleet_file import NO_NAVIGATION, RobotEntry
from pioneer_traffic.suitability import Member, refusal_on_map

Corners = Sequence[Sequence[float]]
"""Of a footprint: x, y [m] about the robot's base."""


def fleet_refusal(
    robots: Sequence[RobotEntry],
    map_file: Path,
    poses: Path,
    shipped: Path,
    footprint_of: Callable[[str], Corners],
) -> str:
    """Returns why a fleet cannot keep the right of way, as a clause for people; empty if it can.

    What cannot be read here is no reason: the nodes that need it report it.

    Args:
        robots: the fleet.
        map_file: YAML file of the world's map.
        poses: folder of the files of initial poses.
        shipped: YAML file of the costmaps' parameters of robots that have none of their own.
        footprint_of: returns the footprint that navigation takes from a description, of a robot without parameters;
            raises ValueError with the reason if there is none.
    """
    navigated = [
        (number, robot)
        for number, robot in enumerate(robots, 1)
        if robot.navigation != NO_NAVIGATION
    ]
    if len(navigated) < 2:
        return "fewer than two robots have this navigation"
    try:
        described = {
            robot.description: footprint_of(robot.description)
            for _, robot in navigated
            if robot.description and not robot.navigation
        }
    except ValueError as error:
        return str(error)
    try:
        common = _mapping(shipped)
        known = _mapping(poses_of(poses, map_file.stem))
        members = {
            robot.name: Member(
                _start(robot, number, known),
                common,
                _own(robot, described),
                bool(robot.description),
            )
            for number, robot in navigated
        }
        return refusal_on_map(map_file, members)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError):
        return ""


def _own(robot: RobotEntry, described: Mapping[str, Corners]) -> Mapping[str, Any]:
    """Returns a robot's own parameters of move_base."""
    if robot.navigation:
        return _mapping(Path(robot.navigation))
    if robot.description:
        return {"local_costmap": {"footprint": described[robot.description]}}
    return {}


def _mapping(file: Path) -> Mapping[str, Any]:
    """Returns the content of a YAML file; nothing if it is no mapping."""
    content = yaml.safe_load(file.read_text())
    return content if isinstance(content, Mapping) else {}


def _start(robot: RobotEntry, number: int, poses: Mapping[str, Any]) -> tuple[float, float]:
    """Returns where a robot starts: its own pose, or that of its name, or that of pioneer``number``."""
    pose = robot.pose or poses.get(robot.name) or poses[f"pioneer{number}"]
    return float(pose["x"]), float(pose["y"])
