"""Builds the fleet's RViz configuration: a template's groups and tools, renamed and recoloured, fitted to the view."""

import colorsys
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

NAMES_TOPIC = "/robot_names/markers"
_PER_ROBOT = {"rviz/SetGoal": "goal", "rviz/SetInitialPose": "pose"}
_HUE_STEP = 0.065
"""Hue offset between two robots that share a group of the template."""


@dataclasses.dataclass(frozen=True)
class RobotView:
    """The names that RViz needs to display a robot."""

    name: str  #: its namespace and tf prefix
    laser: str  #: topic of its laser scans
    description: str = "robot_description"  #: parameter that holds its URDF


@dataclasses.dataclass(frozen=True)
class Bounds:
    """A rectangle of the map [m]."""

    left: float
    bottom: float
    right: float
    top: float


def known_bounds(cells: NDArray[np.int8], resolution: float, x: float, y: float) -> Bounds | None:
    """Returns the rectangle of a map's known cells; None if no cell is known.

    Args:
        cells: [row, col], row 0 at the bottom; -1 for unknown.
        resolution: edge length of a cell [m].
        x: of the outer corner of cell (0, 0) [m].
        y: of the same corner [m].
    """
    known = cells >= 0
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not rows.size:
        return None
    left, right, bottom, top = (
        float(edge) * resolution for edge in (cols[0], cols[-1] + 1, rows[0], rows[-1] + 1)
    )
    return Bounds(x + left, y + bottom, x + right, y + top)


def fitted_scale(bounds: Bounds, size: tuple[int, int]) -> float:
    """Returns the scale [pixels/m] at which a rectangle fills a picture of ``size`` pixels, with a small margin."""
    return 0.94 * min(
        size[0] / (bounds.right - bounds.left), size[1] / (bounds.top - bounds.bottom)
    )


def fleet_config(
    template: Mapping[str, Any], robots: Sequence[RobotView], bounds: Bounds, size: tuple[int, int]
) -> dict[str, Any]:
    """Returns the configuration that shows ``robots`` from above in a scene of ``size`` [pixels].

    The template's groups are assigned to the robots in turn; further robots reuse them in other colours.
    """
    manager = template["Visualization Manager"]
    groups = [one for one in manager["Displays"] if one["Class"] == "rviz/Group"]
    displays = [one for one in manager["Displays"] if one["Class"] != "rviz/Group"]
    owners = tuple(f"/{group['Name']}/" for group in groups)
    tools = [one for one in manager["Tools"] if not str(one.get("Topic", "")).startswith(owners)]
    for index, robot in enumerate(robots):
        displays.append(
            _group(groups[index % len(groups)], robot, _HUE_STEP * (index // len(groups)))
        )
    for kind, what in _PER_ROBOT.items():
        topics = {"goal": "map_goal_pose", "pose": "initialpose"}
        tools += [{"Class": kind, "Topic": f"/{robot.name}/{topics[what]}"} for robot in robots]
    displays.append(
        {"Class": "rviz/MarkerArray", "Name": "Names", "Enabled": True, "Marker Topic": NAMES_TOPIC}
    )
    centre = {"X": (bounds.left + bounds.right) / 2, "Y": (bounds.bottom + bounds.top) / 2}
    view = {**manager["Views"]["Current"], **centre, "Scale": fitted_scale(bounds, size)}
    views = {**manager["Views"], "Current": view}
    return {
        **template,
        "Visualization Manager": {**manager, "Displays": displays, "Tools": tools, "Views": views},
    }


def tool_name(tool: Mapping[str, Any]) -> str:
    """Returns the name of a robot's tool, such as "pioneer1 goal"; empty for a tool that belongs to no robot."""
    what, topic = _PER_ROBOT.get(tool["Class"], ""), str(tool.get("Topic", ""))
    return f"{topic.split('/')[1]} {what}" if what and topic.count("/") > 1 else ""


def _group(template: Mapping[str, Any], robot: RobotView, hue: float) -> dict[str, Any]:
    group: dict[str, Any] = _renamed(template, str(template["Name"]), robot.name)
    for display in group["Displays"]:
        if display["Class"] == "rviz/LaserScan":
            display["Topic"] = robot.laser
        if display["Class"] == "rviz/RobotModel":
            display["Robot Description"] = robot.description
        if "Color" in display:
            display["Color"] = turned(display["Color"], hue)
    return group


def _renamed(value: Any, old: str, new: str) -> Any:
    if isinstance(value, Mapping):
        return {key: _renamed(entry, old, new) for key, entry in value.items()}
    if isinstance(value, list):
        return [_renamed(entry, old, new) for entry in value]
    if isinstance(value, str):
        return new if value == old else value.replace(f"/{old}/", f"/{new}/")
    return value


def turned(colour: str, hue: float) -> str:
    """Returns a colour "red; green; blue" with its hue rotated by ``hue``, a fraction of the circle."""
    parts = colorsys.rgb_to_hsv(*(int(part) / 255 for part in colour.split(";")))
    return "; ".join(
        str(round(255 * part)) for part in colorsys.hsv_to_rgb((parts[0] + hue) % 1, *parts[1:])
    )
