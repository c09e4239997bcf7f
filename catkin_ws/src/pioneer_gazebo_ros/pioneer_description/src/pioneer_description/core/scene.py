"""Finds which displays of an RViz configuration are visible in a picture and which are missing.

A configuration shows each robot in a group named after it. Every coloured display of a group has a unique colour, so
that exact colours identify displays. RViz draws points, lines and maps unlit.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""Shape (height, width, 3), red, green, blue."""
Point = tuple[float, float]

FRAME_RATE = 2
"""Frame rate limit [1/s]: with software rendering a higher rate would take a processor core from the robots."""
TOLERANCE = 6
"""Colour tolerance per channel; llvmpipe rounds, and blends lines with their background at the edges."""
FREE = (253, 253, 253)
"""The colour of a map's free cells in RViz."""
TOP_PLATE = (13, 13, 15)
"""The colour of a Pioneer seen from above."""
NAME_COLOUR = (60, 40, 90)
"""The colour of the robots' name labels."""


class SceneError(ValueError):
    """A configuration does not show a fleet from above; the message says what is missing."""


@dataclass(frozen=True, slots=True)
class View:
    """An orthographic view from above, x to the right, y up."""

    centre: Point  #: centre of the picture in the fixed frame [m]
    scale: float  #: [pixels/m]

    def around(self, image: Image, point: Point, radius: float) -> Image:
        """Returns the square of half-width `radius` [m] around a point, cropped to the image; empty if outside."""
        height, width = image.shape[:2]
        column = width / 2 + (point[0] - self.centre[0]) * self.scale
        row = height / 2 - (point[1] - self.centre[1]) * self.scale
        size = radius * self.scale
        rows = slice(max(0, round(row - size)), max(0, round(row + size) + 1))
        columns = slice(max(0, round(column - size)), max(0, round(column + size) + 1))
        return image[rows, columns]


@dataclass(frozen=True, slots=True)
class Mark:
    """A display that must be visible in the picture."""

    robot: str  #: the robot it belongs to; "" for one shared by all robots
    what: str  #: description, such as "scan"
    colour: tuple[int, int, int] | None  #: red, green, blue; None for the many colours of a costmap
    radius: float = 0.0  #: maximum distance from the robot [m]; 0 for anywhere
    least: int = 8  #: minimum number of pixels
    topic: str = ""  #: the topic that it shows; "" for none, such as a robot model

    def __str__(self) -> str:
        return f"{self.robot}'s {self.what}" if self.robot else f"the {self.what}"


def view_of(config: Mapping[str, Any]) -> View:
    """Returns the initial view of a configuration.

    Raises:
        SceneError: the view is not from above.
    """
    view = config.get("Visualization Manager", {}).get("Views", {}).get("Current", {})
    if view.get("Class") != "rviz/TopDownOrtho" or view.get("Angle", 0) != 0:
        raise SceneError("the current view must be TopDownOrtho with Angle 0")
    return View((float(view.get("X", 0)), float(view.get("Y", 0))), float(view.get("Scale", 10)))


def marks_of(config: Mapping[str, Any]) -> list[Mark]:
    """Returns what a configuration shows while its robots drive, without disabled displays.

    Goals are left out: they disappear when a robot arrives.

    Raises:
        SceneError: it shows no robot, or two displays share a colour.
    """
    displays = [
        one
        for one in config.get("Visualization Manager", {}).get("Displays", ())
        if one.get("Enabled", True)
    ]
    maps = [one for one in displays if one.get("Class") == "rviz/Map"]
    marks = [Mark("", "map", FREE, least=1000, topic=str(one.get("Topic", ""))) for one in maps]
    named = any(one.get("Class") == "rviz/MarkerArray" for one in displays)
    for group in displays:
        if group.get("Class") == "rviz/Group":
            marks += _marks_of_robot(group)
            marks += [Mark(str(group.get("Name", "")), "name", NAME_COLOUR, 2.0)] if named else []
    colours = [mark.colour for mark in marks if mark.colour not in (None, TOP_PLATE, NAME_COLOUR)]
    if len(marks) < 2 or len(set(colours)) != len(colours):
        raise SceneError(
            "each robot needs a group of displays, and each scan and plan a colour of its own"
        )
    return marks


def _marks_of_robot(group: Mapping[str, Any]) -> Iterator[Mark]:
    robot = str(group.get("Name", ""))
    for display in group.get("Displays", ()):
        if not display.get("Enabled", True):
            continue
        name, topic = str(display.get("Name", "")).lower(), str(display.get("Topic", ""))
        match display.get("Class"):
            case "rviz/RobotModel":
                if display.get("Robot Description", "robot_description") == "robot_description":
                    yield Mark(robot, name, TOP_PLATE, 0.6)
            case "rviz/Map":
                yield Mark(robot, name, None, 1.6, 40, topic)
            case "rviz/LaserScan" | "rviz/Path":
                red, green, blue = (
                    int(part) for part in str(display.get("Color", "0; 0; 0")).split(";")
                )
                yield Mark(robot, name, (red, green, blue), topic=topic)


def size_of(config: Mapping[str, Any]) -> tuple[int, int]:
    """Returns width and height of the configuration's window [pixels]."""
    window = config.get("Window Geometry", {})
    return int(window.get("Width", 1500)), int(window.get("Height", 1000))


def alone(config: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the configuration without panels, so that the scene fills the window, at `FRAME_RATE` frames a second."""
    # Without a window manager nothing else sizes the window, not even full-screen mode.
    width, height = size_of(config)
    window = {
        "Width": width,
        "Height": height,
        "X": 0,
        "Y": 0,
        "Hide Left Dock": True,
        "Hide Right Dock": True,
    }
    manager = config.get("Visualization Manager", {})
    options = {**manager.get("Global Options", {}), "Frame Rate": FRAME_RATE}
    manager = {**manager, "Global Options": options}
    return {**config, "Panels": [], "Window Geometry": window, "Visualization Manager": manager}


def missing(
    image: Image, view: View, marks: list[Mark], positions: Mapping[str, Point]
) -> list[Mark]:
    """Returns those of `marks` that are not visible in the picture.

    Args:
        image: the picture.
        view: the view it was taken from.
        marks: what must be visible.
        positions: the robots' positions in the fixed frame [m]; marks near a robot that is not listed count as missing.
    """
    return [mark for mark in marks if not _is_seen(image, view, mark, positions.get(mark.robot))]


def _is_seen(image: Image, view: View, mark: Mark, position: Point | None) -> bool:
    if mark.radius:
        if position is None:
            return False
        image = view.around(image, position, mark.radius)
    seen = _costs(image) if mark.colour is None else _near(image, mark.colour)
    return int(seen.sum()) >= mark.least


def _near(image: Image, colour: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Returns which pixels match a colour, shape (pixels with matching green,)."""
    # Testing one channel first leaves few pixels for the other two.
    few = image[_within(image[..., 1], colour[1])]
    return _within(few[..., 0], colour[0]) & _within(few[..., 2], colour[2])


def _within(channel: Image, value: int) -> NDArray[np.bool_]:
    return (channel >= max(0, value - TOLERANCE)) & (channel <= min(255, value + TOLERANCE))


def _costs(image: Image) -> NDArray[np.bool_]:
    """Returns where free space is tinted from blue to red, or cyan: RViz's costmap colours at an alpha of 0.35."""
    red, green, blue = (image[..., channel].astype(np.int16) for channel in range(3))
    tinted = (np.abs(green - 165) <= TOLERANCE) & (np.abs(red + blue - 419) <= TOLERANCE)
    cyan = (np.abs(red - 165) <= TOLERANCE) & (np.minimum(green, blue) >= 254 - TOLERANCE)
    return tinted | cyan
