"""Whether a fleet can keep the right of way in its world, from the files that describe both."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pioneer_demo.scenario.world_folder import poses_of
from pioneer_node.core.fleet_file import NO_NAVIGATION, RobotEntry
from pioneer_traffic.suitability import Member, refusal_on_map


def fleet_refusal(robots: Sequence[RobotEntry], map_file: Path, poses: Path, shipped: Path) -> str:
    """Returns why a fleet cannot keep the right of way, as a clause for people; empty if it can.

    What cannot be read here is no reason: the nodes that need it report it.

    Args:
        robots: the fleet.
        map_file: YAML file of the world's map.
        poses: folder of the files of initial poses.
        shipped: YAML file of the costmaps' parameters of robots that have none of their own.
    """
    navigated = [
        (number, robot)
        for number, robot in enumerate(robots, 1)
        if robot.navigation != NO_NAVIGATION
    ]
    if len(navigated) < 2:
        return "fewer than two robots have this navigation"
    try:
        common = _mapping(shipped)
        known = _mapping(poses_of(poses, map_file.stem))
        members = {
            robot.name: Member(
                _start(robot, number, known),
                common,
                _mapping(Path(robot.navigation)) if robot.navigation else {},
                bool(robot.description),
            )
            for number, robot in navigated
        }
        return refusal_on_map(map_file, members)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError):
        return ""


def _mapping(file: Path) -> Mapping[str, Any]:
    """Returns the content of a YAML file; nothing if it is no mapping."""
    content = yaml.safe_load(file.read_text())
    return content if isinstance(content, Mapping) else {}


def _start(robot: RobotEntry, number: int, poses: Mapping[str, Any]) -> tuple[float, float]:
    """Returns where a robot starts: its own pose, or that of its name, or that of pioneer``number``."""
    pose = robot.pose or poses.get(robot.name) or poses[f"pioneer{number}"]
    return float(pose["x"]), float(pose["y"])
