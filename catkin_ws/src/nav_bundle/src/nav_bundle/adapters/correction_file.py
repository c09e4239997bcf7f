"""``map`` to ``odom`` on disk: where the robot is, for an amcl that starts while the robot's odometry keeps running."""

import json
import math
import os
from pathlib import Path

from nav_bundle.core.error import NavigationError
from nav_bundle.core.pose import Pose


class CorrectionFileError(NavigationError):
    """The file cannot be read or written, or holds something else."""


def read_correction(path: Path, odom_frame: str) -> Pose | None:
    """Returns the pose of ``odom_frame`` in ``map``; None where there is no file, or it is about another robot's.

    Raises:
        CorrectionFileError: see there.
    """
    try:
        content = json.loads(path.read_text())
        pose, frame = Pose(*(float(content[key]) for key in ("x", "y", "yaw"))), content["odom"]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CorrectionFileError(f"{path} does not hold x, y and yaw in map of an odom frame: {error}") from None
    if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
        raise CorrectionFileError(f"{path} holds a number that is none")
    return pose if frame == odom_frame else None


def write_correction(path: Path, pose: Pose, odom_frame: str) -> None:
    """Replaces the file as a whole, so that a kill at any moment leaves the old one or the new one.

    Raises:
        CorrectionFileError: see there.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(json.dumps({"odom": odom_frame, "x": pose.x, "y": pose.y, "yaw": pose.yaw}) + "\n")
        beside.replace(path)
    except OSError as error:
        raise CorrectionFileError(f"cannot remember the pose in {path}: {error}") from None
