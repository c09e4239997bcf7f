"""Converts between ROS messages and core values."""

import base64
import contextlib
import io
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from numpy.typing import NDArray
from PIL import Image as Picture

from pioneer_fleet.geometry import Points, Pose
from pioneer_fleet.monitor.conversions import (
    MessageError,
    finite,
    frame_from_message,
    points_from_path,
    pose_from_message,
)
from pioneer_web.state.picture import COSTS, png
from pioneer_web.state.robot import BEAMS, Image

FARTHEST_RANGE = 1e4
"""Maximum range of a beam that is shown [m]."""
MOST_GOALS = 200
"""Maximum number of waypoints of a robot that are shown."""
_MODES = {
    "rgb8": ("RGB", "RGB"), "bgr8": ("RGB", "BGR"), "rgba8": ("RGBA", "RGBA"), "bgra8": ("RGBA", "BGRA"),
    "mono8": ("L", "L"), "8UC1": ("L", "L"),
}  # fmt: skip
_DEPTHS = {"16UC1": "<u2", "mono16": "<u2", "32FC1": "<f4"}


def scan_from_message(message: Any) -> tuple[float, float, list[int]]:
    """Returns first angle, angle step [rad] and about 180 ranges [cm] of a ``LaserScan``; 0 means no return."""
    every = max(1, len(message.ranges) // BEAMS)
    ranges = np.asarray(message.ranges[::every], np.float32)
    valid = (
        (ranges >= message.range_min) & (ranges <= message.range_max) & (ranges <= FARTHEST_RANGE)
    )
    lengths = np.where(valid, np.where(valid, ranges, 0) * 100, 0).astype(np.int32).tolist()
    return message.angle_min, message.angle_increment * every, lengths


def line_from_path(message: Any) -> tuple[str, Points]:
    """Returns frame and points of a ``nav_msgs/Path``."""
    return frame_from_message(message.header.frame_id), points_from_path(message)


def cells_from_grid(message: Any) -> NDArray[np.int8]:
    """Returns the cells [row, col] of a ``nav_msgs/OccupancyGrid`` whose ``data`` is a numpy array.

    Raises:
        MessageError: there are none, or not as many as its size says.
    """
    info = message.info
    if not message.data.size or message.data.size != info.height * info.width:
        raise MessageError(f"a grid of {info.width} x {info.height} has {message.data.size} cells")
    finite(info.resolution, "resolution")
    cells: NDArray[np.int8] = message.data.reshape(info.height, info.width)
    return cells


def costs_from_grid(message: Any) -> tuple[str, Image]:
    """Returns frame and image of a ``nav_msgs/OccupancyGrid`` whose ``data`` is a numpy array."""
    info = message.info
    cells = cells_from_grid(message)
    text = base64.b64encode(png(cells, COSTS)).decode()
    size = info.width * info.resolution, info.height * info.resolution
    return frame_from_message(message.header.frame_id), Image(
        pose_from_message(info.origin), *size, text
    )


def jpeg_from_image(message: Any) -> bytes:
    """Returns a ``sensor_msgs/Image`` as JPEG: colour and grey unchanged, depth from black (near) to white (far).

    Raises:
        ValueError: the encoding is not supported.
    """
    size, encoding = (message.width, message.height), message.encoding
    if encoding in _DEPTHS:
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        cells = np.nan_to_num(
            rows.view(_DEPTHS[encoding])[:, : message.width].astype(np.float32), posinf=0.0
        )
        picture = Picture.fromarray((255 * cells / max(1e-6, float(cells.max()))).astype(np.uint8))
    elif encoding in _MODES:
        mode, raw = _MODES[encoding]
        picture = Picture.frombytes(
            mode, size, bytes(message.data), "raw", raw, message.step
        ).convert("RGB")
    else:
        raise ValueError(f"images of the encoding {encoding!r} cannot be shown")
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=70)
    return file.getvalue()


def goals_from_queue(message: Any) -> tuple[Pose, ...]:
    """Returns the waypoints in ``map`` of a ``simple_navigation_goals/WaypointQueue``, the current one first."""
    goals = []
    for waypoint in (message.current, *message.waiting[:MOST_GOALS]):
        if frame_from_message(waypoint.header.frame_id) == "map":
            with contextlib.suppress(MessageError):  # leave out this one
                goals.append(pose_from_message(waypoint.pose))
    return tuple(goals)


def message_from_pose(pose: Pose) -> PoseMessage:
    """Returns a 2D pose as ``geometry_msgs/Pose``."""
    turn = Quaternion(0.0, 0.0, np.sin(pose.yaw / 2), np.cos(pose.yaw / 2))
    return PoseMessage(Point(pose.x, pose.y, 0.0), turn)


def goal_from_pose(pose: Pose) -> PoseStamped:
    """Returns a waypoint in ``map`` as ``geometry_msgs/PoseStamped``."""
    message = PoseStamped(pose=message_from_pose(pose))
    message.header.frame_id = "map"
    return message
