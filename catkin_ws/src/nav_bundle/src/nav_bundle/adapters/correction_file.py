"""``map`` to ``odom`` on disk, so that a restarted amcl recovers the pose while the odometry keeps running."""

import json
import math
import os
from pathlib import Path

from nav_bundle.core.error import NavigationError
from nav_bundle.core.pose import Pose


class CorrectionFileError(NavigationError):
    """The file cannot be read, written or removed, or its content is invalid."""


class CorrectionFile:
    """The correction file at ``path``. With an empty path nothing is read, written or removed."""

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None

    def read(self, odom_frame: str) -> Pose | None:
        """Returns the pose of ``odom_frame`` in ``map``; None if there is no file or it holds another odom frame.

        Raises:
            CorrectionFileError: the file cannot be read, or its content is invalid.
        """
        if self._path is None:
            return None
        try:
            content = json.loads(self._path.read_text())
            pose, frame = Pose(*(float(content[key]) for key in ("x", "y", "yaw"))), content["odom"]
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            text = f"{self._path} does not hold x, y and yaw in map of an odom frame: {error}"
            raise CorrectionFileError(text) from None
        if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
            raise CorrectionFileError(f"{self._path} holds a number that is not finite")
        return pose if frame == odom_frame else None

    def write(self, pose: Pose, odom_frame: str) -> None:
        """Replaces the file atomically: a process killed at any moment leaves either the old or the new file.

        Raises:
            CorrectionFileError: the file cannot be written.
        """
        if self._path is None:
            return
        beside = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            beside.write_text(json.dumps({"odom": odom_frame, "x": pose.x, "y": pose.y, "yaw": pose.yaw}) + "\n")
            beside.replace(self._path)
        except OSError as error:
            raise CorrectionFileError(f"cannot remember the pose in {self._path}: {error}") from None

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
