"""Makes a top-view video of a run: draws the frames after the run and pipes each to ffmpeg."""

import itertools
import math
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from pioneer_demo.error import VideoError
from pioneer_demo.observer.recording import Recording
from pioneer_demo.observer.track import RobotTrack, Visit
from pioneer_demo.report import colour
from pioneer_demo.scenario.floor import Floor
from pioneer_fleet.geometry import Points, Pose

RATE = 10
"""Frames per simulated second, and per second of video."""

LONGER_SIDE = 960
"""Longer side of the map in the video [px]."""

_INK = "#2f3640"
_FONT, _LINE, _MARGIN = 14, 24, 10
_GOAL = 9
_DASH, _GAP = 7.0, 5.0
"""Sizes [px]."""

_NOSE, _TAIL, _HALF_WIDTH = 0.20, -0.30, 0.20
"""Extent of the robot ahead of, behind and to each side of base_link [m]."""


def encoder() -> str:
    """Returns the path of ffmpeg.

    Raises:
        VideoError: ffmpeg is not installed.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise VideoError("--video needs ffmpeg, which is not installed: apt install ffmpeg")
    return found


def write_video(
    floor: Floor, recording: Recording, robots: Sequence[RobotTrack], path: Path
) -> int:
    """Writes a video of a recording; returns its number of frames.

    Raises:
        VideoError: ffmpeg is not installed or fails, or nothing was recorded.
    """
    times = recording.times(RATE)
    if not len(times):
        raise VideoError(f"{path}: no film, for no robot was seen")
    stage = _Stage(floor.cropped(), recording, robots)
    command = [
        encoder(), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24",
        "-s", f"{stage.width}x{stage.height}", "-r", str(RATE), "-i", "-",
        "-an", "-c:v", "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(path),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for time in times:
                process.stdin.write(stage.frame(float(time)))
            process.stdin.close()
        except BrokenPipeError:
            pass  # ffmpeg's error output gives the reason
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise VideoError(
            f"{path}: ffmpeg failed: {said.splitlines()[-1] if said else process.returncode}"
        )
    return len(times)


class _Stage:
    """Draws frames in time order: the map with growing trails, above a legend."""

    def __init__(self, floor: Floor, recording: Recording, robots: Sequence[RobotTrack]) -> None:
        rows, cols = floor.free.shape
        self._scale = LONGER_SIDE / (max(rows, cols) * floor.resolution)
        self._x, self._top = floor.x, floor.y + rows * floor.resolution
        self._recording, self._robots = recording, robots
        self._paint = {robot.name: colour.of_robot(index) for index, robot in enumerate(robots)}
        self._font = ImageFont.truetype(
            str(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), _FONT
        )
        # Encoders require even dimensions.
        self.width, floor_height = (
            2 * round(n * floor.resolution * self._scale / 2) for n in (cols, rows)
        )
        self._legend = _Legend(self._font, self._paint, self.width)
        self.height: int = floor_height + self._legend.height
        self._trails = Image.new("RGB", (self.width, self.height), "white")
        self._trails.paste(
            _picture_of(floor).resize((self.width, floor_height), Image.Resampling.BOX)
        )
        self._legend.draw(ImageDraw.Draw(self._trails), floor_height)
        self._last: dict[str, tuple[float, float]] = {}

    def frame(self, time: float) -> bytes:
        """Returns the frame at ``time`` as raw RGB rows."""
        poses = {
            name: pose
            for name in self._paint
            if (pose := self._recording.pose(name, time)) is not None
        }
        self._extend_trails(poses)
        image = self._trails.copy()
        pen = ImageDraw.Draw(image)
        for name in poses:
            self._draw_scan(pen, name, time)
        for robot in self._robots:
            self._draw_errand(pen, robot, time)
        for name, pose in poses.items():
            self._draw_robot(pen, pose, name)
        pen.text(
            (_MARGIN, self.height - _LINE / 2),
            f"{time:.1f} s",
            fill=_INK,
            font=self._font,
            anchor="lm",
        )
        return image.tobytes()

    def _pixel(self, x: float, y: float) -> tuple[float, float]:
        return (x - self._x) * self._scale, (self._top - y) * self._scale

    def _extend_trails(self, poses: dict[str, Pose]) -> None:
        pen = ImageDraw.Draw(self._trails)
        for name, pose in poses.items():
            here = self._pixel(pose.x, pose.y)
            if name in self._last:
                pen.line([self._last[name], here], fill=self._paint[name], width=2)
            self._last[name] = here

    def _draw_scan(self, pen: ImageDraw.ImageDraw, name: str, time: float) -> None:
        """Draws the newest scan from the robot's pose at the scan's stamp."""
        stamp, hits = self._recording.scan(name, time)
        pose = self._recording.pose(name, stamp)
        if pose is None:
            return
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        x = pose.x + cos * hits[:, 0] - sin * hits[:, 1]
        y = pose.y + sin * hits[:, 0] + cos * hits[:, 1]
        spots = np.column_stack([(x - self._x) * self._scale, (self._top - y) * self._scale])
        light = tuple((2 * part + 255) // 3 for part in ImageColor.getrgb(self._paint[name])[:3])
        for u, v in spots:
            pen.rectangle([u - 1, v - 1, u + 1, v + 1], fill=light)

    def _draw_errand(self, pen: ImageDraw.ImageDraw, robot: RobotTrack, time: float) -> None:
        """Draws a robot's plan while it has goals left, and its goals; reached goals are filled."""
        paint, over = self._paint[robot.name], [_is_over(visit, time) for visit in robot.visits]
        if not all(over):
            _draw_dashes(
                pen,
                [self._pixel(*point) for point in self._recording.plan(robot.name, time)],
                paint,
            )
        for number, (visit, reached) in enumerate(zip(robot.visits, over, strict=True), 1):
            where = self._pixel(visit.leg.goal.x, visit.leg.goal.y)
            _draw_goal(pen, where, paint, reached and bool(visit.reached))
            pen.text(
                where, str(number), fill="white" if reached else paint, font=self._font, anchor="mm"
            )

    def _draw_robot(self, pen: ImageDraw.ImageDraw, pose: Pose, name: str) -> None:
        outline = [
            (_TAIL, -_HALF_WIDTH),
            (_TAIL, _HALF_WIDTH),
            (0.0, _HALF_WIDTH),
            (_NOSE, 0.0),
            (0.0, -_HALF_WIDTH),
        ]
        corners = [pose.compose(Pose(x, y)) for x, y in outline]
        pen.polygon(
            [self._pixel(one.x, one.y) for one in corners], fill=self._paint[name], outline=_INK
        )
        u, v = self._pixel(pose.x, pose.y)
        pen.text(
            (u, v - _LINE),
            name,
            fill=_INK,
            font=self._font,
            anchor="mm",
            stroke_width=2,
            stroke_fill="white",
        )


class _Legend:
    """Legend of colours and symbols, in as many lines as needed below the map. A last line is left for the time."""

    def __init__(self, font: ImageFont.FreeTypeFont, paint: Mapping[str, str], width: int) -> None:
        self._font = font
        entries = [
            *paint.items(),
            *((text, "") for text in ("goal", "goal reached", "plan", "way driven", "scan")),
        ]
        self._entries = list[tuple[float, int, str, str]]()
        x, line = float(_MARGIN), 0
        for text, colour_ in entries:
            size = 3 * _GOAL + font.getlength(text) + 2 * _MARGIN
            if x + size > width:
                x, line = float(_MARGIN), line + 1
            self._entries.append((x, line, text, colour_))
            x += size
        self.height = _LINE * (line + 2)

    def draw(self, pen: ImageDraw.ImageDraw, top: int) -> None:
        """Draws the legend below row ``top``."""
        for left, line, text, paint in self._entries:
            x, y = left + _GOAL, top + _LINE * (line + 0.5)
            self._draw_sign(pen, x, y, text, paint)
            pen.text((x + 2 * _GOAL, y), text, fill=_INK, font=self._font, anchor="lm")

    def _draw_sign(
        self, pen: ImageDraw.ImageDraw, x: float, y: float, text: str, paint: str
    ) -> None:
        ends = (x - _GOAL, y), (x + _GOAL, y)
        if paint:
            pen.rectangle([x - _GOAL, y - _GOAL / 2, x + _GOAL, y + _GOAL / 2], fill=paint)
        elif text.startswith("goal"):
            _draw_goal(pen, (x, y), _INK, text != "goal")
        elif text == "plan":
            _draw_dashes(pen, [(x + step, y) for step in range(-_GOAL, _GOAL)], _INK)
        elif text == "scan":
            pen.point(
                [(x + step, y + side) for step in range(-_GOAL, _GOAL, 4) for side in (0, 1)],
                fill=_INK,
            )
        else:
            pen.line(ends, fill=_INK, width=2)


def _is_over(visit: Visit, time: float) -> bool:
    return visit.reached is not None and visit.time <= time


def _draw_goal(
    pen: ImageDraw.ImageDraw, where: tuple[float, float], paint: str, reached: bool
) -> None:
    x, y = where
    pen.ellipse(
        [x - _GOAL, y - _GOAL, x + _GOAL, y + _GOAL],
        fill=paint if reached else "white",
        outline=paint,
        width=2,
    )


def _draw_dashes(pen: ImageDraw.ImageDraw, points: Points, paint: str) -> None:
    travelled = 0.0
    for start, end in itertools.pairwise(points):
        step = math.dist(start, end)
        if travelled % (_DASH + _GAP) < _DASH:
            pen.line([start, end], fill=paint, width=1)
        travelled += step


def _picture_of(floor: Floor) -> Image.Image:
    """Returns the map as a colour image, one pixel per cell, +y up."""
    shades = np.array(
        [ImageColor.getrgb(one) for one in (colour.UNKNOWN, colour.FREE, colour.WALL)], np.uint8
    )
    cells = np.where(floor.occupied, 2, np.where(floor.free, 1, 0))
    return Image.fromarray(shades[cells[::-1]])
