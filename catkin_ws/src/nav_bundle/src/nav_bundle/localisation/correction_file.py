"""``map`` to ``odom`` on disk, so that a restarted amcl recovers the pose while the odometry keeps running."""

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose, angle_difference

_AT_ZERO = 0.02
"""Odometry this near to zero was restarted, unless it was there before [m]; a robot hardly comes back so exactly."""
_FARTHEST = 1.5
"""How far a robot drives on at most after the last estimate, with which the file was written [m]."""
_CLEAR_GAIN = 0.2
"""A scan tells two places apart if the shares of its beams that fit there differ by more than this."""


class CorrectionFileError(NavigationError):
    """The file cannot be read, written or removed, or its content is invalid."""


class Correction(NamedTuple):
    """What amcl needs to resume."""

    map_from_odom: Pose  #: pose of the odometry frame in the map
    odom: Pose  #: the robot's pose in the odometry frame at that time

    def applies_to(self, odom: Pose) -> bool:
        """Returns whether odometry that reads ``odom`` now seems to have continued since.

        Odometry that was restarted counts from zero. It reads zero, or is nearer to zero than to where it was and
        farther from there than the robot can have moved: a robot that drove on to near its start has not restarted.
        """
        moved = _apart(odom, self.odom)
        if _apart(odom, Pose()) < _AT_ZERO < moved:
            return False
        return moved <= _FARTHEST or moved <= _apart(odom, Pose())


def has_continued(
    remembered: Correction, initial: Pose, odom: Pose, agreement: Callable[[Pose], float]
) -> bool:
    """Returns whether odometry has continued since, and was not restarted at zero at the initial pose.

    The scan tells where the robot is. Where both places look alike, the odometry's own reading decides.

    Args:
        remembered: what the amcl before this one has kept.
        initial: where this one would start without.
        odom: the robot's pose in the odometry frame now.
        agreement: returns the share of the scan's beams that fit the map at a pose.
    """
    gain = agreement(remembered.map_from_odom.compose(odom)) - agreement(initial.compose(odom))
    if abs(gain) > _CLEAR_GAIN:
        return gain > 0.0
    return remembered.applies_to(odom)


def _apart(first: Pose, second: Pose) -> float:
    """Returns how far apart two poses are [m], with half a metre for each radian."""
    return first.distance(second) + 0.5 * abs(angle_difference(first.yaw, second.yaw))


class CorrectionFile:
    """The correction file at ``path``. With an empty path nothing is read, written or removed."""

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None

    def read(self, odom_frame: str) -> Correction | None:
        """Returns the correction of ``odom_frame``; None if there is no file or it holds another odom frame.

        Raises:
            CorrectionFileError: the file cannot be read, or its content is invalid.
        """
        if self._path is None:
            return None
        try:
            content = json.loads(self._path.read_text())
            frame = content["odom"]
            correction = Correction(_pose(content, ""), _pose(content, "odom_"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            text = f"{self._path} does not hold x, y and yaw of an odom frame in map and of the robot in it: {error}"
            raise CorrectionFileError(text) from None
        for pose in correction:
            if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
                raise CorrectionFileError(f"{self._path} holds a number that is not finite")
        return correction if frame == odom_frame else None

    def write(self, correction: Correction, odom_frame: str) -> None:
        """Replaces the file atomically: a process killed at any moment leaves either the old or the new file.

        Raises:
            CorrectionFileError: the file cannot be written.
        """
        if self._path is None:
            return
        beside = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            content: dict[str, Any] = {"odom": odom_frame}
            content |= _fields(correction.map_from_odom, "") | _fields(correction.odom, "odom_")
            beside.write_text(json.dumps(content) + "\n")
            beside.replace(self._path)
        except OSError as error:
            raise CorrectionFileError(
                f"cannot remember the pose in {self._path}: {error}"
            ) from None

    def forget(self) -> None:
        """Removes the file, if it exists.

        Raises:
            CorrectionFileError: the file cannot be removed.
        """
        try:
            if self._path is not None:
                self._path.unlink(missing_ok=True)
        except OSError as error:
            raise CorrectionFileError(f"cannot remove the outdated {self._path}: {error}") from None


def _pose(content: Any, prefix: str) -> Pose:
    """Returns the pose whose fields have the names ``prefix`` and x, y, yaw."""
    x, y, yaw = (float(content[f"{prefix}{name}"]) for name in ("x", "y", "yaw"))
    return Pose(x, y, yaw)


def _fields(pose: Pose, prefix: str) -> dict[str, Any]:
    return {f"{prefix}x": pose.x, f"{prefix}y": pose.y, f"{prefix}yaw": pose.yaw}
