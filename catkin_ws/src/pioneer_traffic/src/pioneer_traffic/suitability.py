"""Whether robots can keep the right of way on a map: with their footprints, from their starts.

No ROS, no clock.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from nav_bundle.base.error import NavigationError
from nav_bundle.costmap.footprint import Footprint, footprint_from_parameters
from nav_bundle.maps.grid import Grid
from nav_bundle.maps.map_file import read_map
from pioneer_traffic.config import PilotConfig
from pioneer_traffic.geometry import Point
from pioneer_traffic.roadmap import FreeSpace, RoadmapConfig, largest_part

_COSTMAPS = ("local_costmap", "global_costmap")
_PLANNERS = ("TrajectoryPlannerROS", "DWAPlannerROS")
"""Groups of move_base's parameters."""
_DEFAULT_RADIUS = 0.46
"""costmap_2d's default of robot_radius [m]."""
_NEAR = 0.5
"""Distance from the roadmap's ground within which a robot may start [m]."""
_LEAST = 1.0
"""Ground behind narrow passages that counts [m²]: less is room that map images have by chance."""
_EIGHT = np.ones((3, 3))
"""Cells that touch at a corner count as connected."""


@dataclass(frozen=True)
class Member:
    """A robot of a fleet."""

    start: Point  #: where it starts: x, y [m], frame map
    common: Mapping[str, Any]  #: parameters of its costmaps that all robots have
    own: Mapping[str, Any]  #: parameters of its move_base that replace them, by group
    #: whether it has a description of its own, from which its footprint is computed only when it starts
    is_described: bool = False


def refusal_on_map(map_file: Path, members: Mapping[str, Member]) -> str:
    """Returns why a fleet cannot keep the right of way, as a clause for people; empty if it can.

    What cannot be read here is no reason: the nodes that need it report it.

    Args:
        map_file: YAML file of the map.
        members: the robots, by name.
    """
    reach = PilotConfig().reach
    try:
        for name, member in members.items():
            if member.is_described and not _has_footprint(member):
                return f"the footprint of {name} is not in its file of move_base parameters"
            tolerance = _tolerance(member)
            if tolerance > reach:
                return (
                    f"the xy_goal_tolerance of {name} is {tolerance:g} m, "
                    f"and robots must come within {reach:g} m of places"
                )
        starts = {name: member.start for name, member in members.items()}
        footprints = {name: _footprint(member) for name, member in members.items()}
        return refusal(read_map(map_file), starts, footprints)
    except (NavigationError, TypeError, ValueError):
        return ""


def _section(parameters: Mapping[str, Any], names: Sequence[str]) -> Mapping[str, Any]:
    """Returns the first of the named groups of parameters; nothing if there is none."""
    groups = (parameters.get(name) for name in names)
    return next((group for group in groups if isinstance(group, Mapping)), {})


def _has_footprint(member: Member) -> bool:
    """Returns whether a robot's own parameters say its footprint."""
    given = _section(member.own, _COSTMAPS)
    return bool(given.get("footprint") or given.get("robot_radius"))


def _footprint(member: Member) -> Footprint:
    """Returns a robot's footprint without padding."""
    given = {**member.common, **_section(member.own, _COSTMAPS)}
    radius = float(given.get("robot_radius", _DEFAULT_RADIUS))
    return footprint_from_parameters(given.get("footprint"), radius, 0.0)


def _tolerance(member: Member) -> float:
    """Returns the distance from a goal at which a robot may stop [m]; 0 if it has the shipped one."""
    return float(_section(member.own, _PLANNERS).get("xy_goal_tolerance", 0.0))


def refusal(
    grid: Grid,
    starts: Mapping[str, Point],
    footprints: Mapping[str, Footprint],
    config: RoadmapConfig | None = None,
) -> str:
    """Returns why robots cannot keep the right of way, as a clause for people; empty if they can.

    Args:
        grid: the map.
        starts: by robot, where it starts: x, y [m], frame map.
        footprints: by robot, its footprint without padding.
        config: geometry of the roadmap.
    """
    config = config or RoadmapConfig()
    for name, footprint in footprints.items():
        radius = footprint.circumscribed_radius
        if radius > config.driving_radius:
            return (
                f"the footprint of {name} reaches {radius:.2f} m from its centre, "
                f"and the places of the roadmap have room for {config.driving_radius:g} m"
            )
    space = FreeSpace.of_grid(grid)
    part = largest_part(space, config.passing_radius)
    turning = space.room >= config.driving_radius
    if not (part & turning).any():
        return "nowhere in the map can a robot turn"
    distance = ndimage.distance_transform_edt(~part) * space.resolution
    for name, start in starts.items():
        cell = _cell(space, start)
        if cell is None or distance[cell] > _NEAR:
            return f"no way at least {2.0 * config.passing_radius:.2f} m wide leads to the start of {name}"
    radius = min((one.inscribed_radius for one in footprints.values()), default=0.0)
    beyond = _reachable(space, radius, starts.values()) & turning & ~part
    if beyond.sum() * space.resolution**2 > _LEAST:
        return (
            f"a part of the map is behind passages narrower than {2.0 * config.passing_radius:.2f} m, "
            "which the roadmap does not use"
        )
    return ""


def _reachable(space: FreeSpace, radius: float, starts: Iterable[Point]) -> NDArray[np.bool_]:
    """Returns the cells that a disc can reach from any of the starts, shape (rows, cols)."""
    labels, _ = ndimage.label(space.room >= radius, structure=_EIGHT)
    cells = [cell for start in starts if (cell := _cell(space, start)) is not None]
    found = {int(labels[cell]) for cell in cells} - {0}
    return np.isin(labels, list(found))


def _cell(space: FreeSpace, point: Point) -> tuple[int, int] | None:
    """Returns the row and column of a point; None outside the map."""
    col, row = space.cells_at(np.array([point]))[0].tolist()
    rows, cols = space.room.shape
    return (row, col) if 0 <= row < rows and 0 <= col < cols else None
