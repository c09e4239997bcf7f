"""Draws the fleet's paths on its map."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot
from matplotlib.colors import ListedColormap
from scipy import ndimage

from pioneer_demo.observer.fleet import Fleet
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.report import colour
from pioneer_demo.scenario.floor import Floor

_FLOOR = ListedColormap([colour.UNKNOWN, colour.FREE, colour.WALL])
_MARGIN = 0.8


def draw_fleet(floor: Floor, fleet: Fleet, title: str, path: Path) -> None:
    """Writes a PNG: map, planned paths dashed, driven paths solid, numbered waypoints, starts; one colour per robot."""
    floor = floor.cropped()
    rows, cols = floor.free.shape
    width, height = cols * floor.resolution, rows * floor.resolution
    longest = max(width, height)
    figure, axes = pyplot.subplots(
        figsize=(1.0 + 7.0 * width / longest, 1.6 + 7.0 * height / longest), dpi=120
    )
    # Thicken walls: one or two cells would appear as hairlines.
    walls = ndimage.binary_dilation(floor.occupied)
    shade = np.where(walls, 2, np.where(floor.free, 1, 0))
    extent = (floor.x, floor.x + width, floor.y, floor.y + height)
    axes.imshow(
        shade, cmap=_FLOOR, vmin=0, vmax=2, origin="lower", extent=extent, interpolation="nearest"
    )
    for index, robot in enumerate(fleet.robots):
        _draw_robot(axes, robot, colour.of_robot(index))
    _dress(axes, extent, title)
    figure.savefig(path, bbox_inches="tight", pad_inches=0.15, facecolor="white")
    pyplot.close(figure)


def _draw_robot(axes: Any, robot: RobotTrack, paint: str) -> None:
    for visit in robot.visits:
        if visit.planned:
            planned = np.array(visit.planned)
            axes.plot(
                *planned.T, color=paint, linewidth=1.1, linestyle=(0, (4, 3)), alpha=0.8, zorder=3
            )
    label = (
        f"{robot.name}: {robot.reached}/{len(robot.visits)} waypoints, {robot.path_length:.1f} m"
    )
    driven = np.array(robot.driven or [(np.nan, np.nan)])
    axes.plot(
        *driven.T,
        color=paint,
        linewidth=2.4,
        alpha=0.75,
        solid_capstyle="round",
        zorder=4,
        label=label,
    )
    if robot.driven:
        axes.plot(
            *robot.driven[0],
            marker="s",
            markersize=8,
            color=paint,
            markeredgecolor="white",
            zorder=6,
        )
    for number, visit in enumerate(robot.visits, 1):
        x, y = visit.leg.goal.x, visit.leg.goal.y
        face, ink = (paint, "white") if visit.reached else ("white", paint)
        axes.plot(
            x, y, marker="o", markersize=14, markerfacecolor=face, markeredgecolor=paint, zorder=7
        )
        style = {"ha": "center", "va": "center", "fontsize": 8.5, "fontweight": "bold"}
        axes.annotate(str(number), (x, y), color=ink, zorder=8, **style)


def _dress(axes: Any, extent: tuple[float, float, float, float], title: str) -> None:
    axes.set_xlim(extent[0] - _MARGIN, extent[1] + _MARGIN)
    axes.set_ylim(extent[2] - _MARGIN, extent[3] + _MARGIN)
    axes.set_aspect("equal")
    axes.set_title(title, loc="left", fontsize=11, color="#2f3640", pad=10)
    axes.set_xlabel("x [m] in map", fontsize=9, color="#57606a")
    axes.set_ylabel("y [m]", fontsize=9, color="#57606a")
    axes.tick_params(labelsize=8, colors="#57606a", length=3)
    for side in axes.spines.values():
        side.set_visible(False)
    handles, _ = axes.get_legend_handles_labels()
    key = [
        pyplot.Line2D([], [], color="#57606a", linewidth=2.4, label="driven (ground truth)"),
        pyplot.Line2D(
            [], [], color="#57606a", linewidth=1.1, linestyle=(0, (4, 3)), label="planned"
        ),
        pyplot.Line2D(
            [], [], color="#57606a", marker="s", linestyle="", markersize=7, label="start"
        ),
    ]
    # Below the map, where it takes a line or two; beside it, a third of the picture would stay empty.
    axes.legend(
        handles=[*handles, *key], loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=3, frameon=False, fontsize=9
    )  # fmt: skip
