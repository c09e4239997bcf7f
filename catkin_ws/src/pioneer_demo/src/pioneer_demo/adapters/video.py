"""A film of a run from above: each frame is drawn after the run and handed to ffmpeg at once."""

import math
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from pioneer_demo.adapters import colour
from pioneer_demo.core.error import VideoError
from pioneer_demo.core.floor import Floor
from pioneer_demo.core.geometry import Pose
from pioneer_demo.core.recording import Recording

RATE = 10
"""Frames a simulated second, and a second of film."""

LONGER_SIDE = 960
"""[pixel]."""

_NOSE, _TAIL, _HALF_WIDTH = 0.20, -0.30, 0.20
"""The robot's outline ahead, behind and to each side of base_link [m]."""


def encoder() -> str:
    """Returns the path of ffmpeg.

    Raises:
        VideoError: it is not installed.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise VideoError("--video needs ffmpeg, which is not installed: apt install ffmpeg")
    return found


def write_video(floor: Floor, recording: Recording, names: Sequence[str], path: Path) -> int:
    """Writes a film of all that was recorded and returns its number of frames.

    Raises:
        VideoError: ffmpeg is not installed or fails, or nothing was recorded.
    """
    times = recording.times(RATE)
    if not len(times):
        raise VideoError(f"{path}: no film, for no robot was seen")
    stage = _Stage(floor.cropped(), recording, names)
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
            pass  # its own words say why
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise VideoError(f"{path}: ffmpeg failed: {said.splitlines()[-1] if said else process.returncode}")
    return len(times)


class _Stage:
    """Draws frames in the order of time: trails grow on the floor's picture."""

    def __init__(self, floor: Floor, recording: Recording, names: Sequence[str]) -> None:
        rows, cols = floor.free.shape
        self._scale = LONGER_SIDE / (max(rows, cols) * floor.resolution)
        self._x, self._top = floor.x, floor.y + rows * floor.resolution
        # Encoders want even sides.
        self.width, self.height = (2 * round(n * floor.resolution * self._scale / 2) for n in (cols, rows))
        self._recording, self._names = recording, names
        self._trails = _picture_of(floor).resize((self.width, self.height), Image.Resampling.BOX)
        self._last: dict[str, tuple[float, float]] = {}

    def frame(self, time: float) -> bytes:
        """Returns the picture at ``time`` as rows of red, green, blue."""
        poses = {name: pose for name in self._names if (pose := self._recording.pose(name, time)) is not None}
        self._extend_trails(poses)
        image = self._trails.copy()
        pen = ImageDraw.Draw(image)
        for name in poses:
            self._draw_scan(pen, name, time)
        for name, pose in poses.items():
            self._draw_robot(pen, pose, name)
        _label(pen, 8, self.height - 18, f"{time:.1f} s")
        return image.tobytes()

    def _pixel(self, x: float, y: float) -> tuple[float, float]:
        return (x - self._x) * self._scale, (self._top - y) * self._scale

    def _colour(self, name: str) -> str:
        return colour.of_robot(self._names.index(name))

    def _extend_trails(self, poses: dict[str, Pose]) -> None:
        pen = ImageDraw.Draw(self._trails)
        for name, pose in poses.items():
            here = self._pixel(pose.x, pose.y)
            if name in self._last:
                pen.line([self._last[name], here], fill=self._colour(name), width=2)
            self._last[name] = here

    def _draw_scan(self, pen: ImageDraw.ImageDraw, name: str, time: float) -> None:
        """Draws the newest scan from where the robot was when it was taken."""
        stamp, hits = self._recording.scan(name, time)
        pose = self._recording.pose(name, stamp)
        if pose is None:
            return
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        x = pose.x + cos * hits[:, 0] - sin * hits[:, 1]
        y = pose.y + sin * hits[:, 0] + cos * hits[:, 1]
        spots = np.column_stack([(x - self._x) * self._scale, (self._top - y) * self._scale])
        light = tuple((2 * part + 255) // 3 for part in ImageColor.getrgb(self._colour(name))[:3])
        for u, v in spots:
            pen.rectangle([u - 1, v - 1, u + 1, v + 1], fill=light)

    def _draw_robot(self, pen: ImageDraw.ImageDraw, pose: Pose, name: str) -> None:
        outline = [(_TAIL, -_HALF_WIDTH), (_TAIL, _HALF_WIDTH), (0.0, _HALF_WIDTH), (_NOSE, 0.0), (0.0, -_HALF_WIDTH)]
        corners = [pose.compose(Pose(x, y)) for x, y in outline]
        pen.polygon([self._pixel(one.x, one.y) for one in corners], fill=self._colour(name), outline="#2f3640")
        u, v = self._pixel(pose.x, pose.y)
        _label(pen, u + 12, v - 16, name)


def _label(pen: ImageDraw.ImageDraw, x: float, y: float, text: str) -> None:
    pen.rectangle(pen.textbbox((x, y), text), fill="white")
    pen.text((x, y), text, fill="#2f3640")


def _picture_of(floor: Floor) -> Image.Image:
    """Returns the map in colours, one pixel a cell, north up."""
    shades = np.array([ImageColor.getrgb(one) for one in (colour.UNKNOWN, colour.FREE, colour.WALL)], np.uint8)
    cells = np.where(floor.occupied, 2, np.where(floor.free, 1, 0))
    return Image.fromarray(shades[cells[::-1]])
