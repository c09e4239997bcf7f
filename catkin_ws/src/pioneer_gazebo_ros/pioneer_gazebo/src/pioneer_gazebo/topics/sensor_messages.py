"""Converts what sensors measure to messages."""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, JointState, LaserScan, PointCloud2, PointField, Range

from pioneer_gazebo.laser.laser import Laser
from pioneer_gazebo.ros.messages import Stamped
from pioneer_gazebo.sensors.camera import Depth, Picture, intrinsics_of
from pioneer_gazebo.world.robot import Camera, LaserSensor, SonarSensor


class ScanTemplate(Stamped):
    """sensor_msgs/LaserScan without intensities."""

    def __init__(self, config: LaserSensor, frame: str, laser: Laser) -> None:
        """Takes the laser's settings, the frame id and its beams."""
        message = LaserScan(
            angle_min=laser.first, angle_max=laser.last, angle_increment=laser.increment
        )
        message.header.frame_id = frame
        message.range_min, message.range_max = config.min_range, config.max_range
        message.scan_time = 1.0 / config.update_rate if config.update_rate > 0 else 0.0
        message.ranges = [0.0] * config.samples
        super().__init__(message)
        self._ranges = np.frombuffer(self.frame, "<f4", config.samples, self.body_start + 7 * 4 + 4)

    def fill(self, time: int, ranges: NDArray[np.float64]) -> bytearray:
        """Returns the frame for a time [ns] and ranges [m]."""
        self.stamp(time)
        self._ranges[:] = ranges
        return self.frame


class JointStateTemplate(Stamped):
    """sensor_msgs/JointState without efforts."""

    def __init__(self, names: Sequence[str]) -> None:
        """Takes the joint names, in the order used by `fill`."""
        count = len(names)
        message = JointState(name=list(names), position=[0.0] * count, velocity=[0.0] * count)
        super().__init__(message)
        self._positions = self.body_start + 4 + sum(4 + len(name.encode()) for name in names) + 4
        self._velocities = self._positions + 8 * count + 4
        self._numbers = struct.Struct(f"<{count}d")

    def fill(self, time: int, states: Sequence[tuple[float, float]]) -> bytearray:
        """Returns the frame for a time [ns] and each joint's position and speed."""
        self.stamp(time)
        self._numbers.pack_into(self.frame, self._positions, *[state[0] for state in states])
        self._numbers.pack_into(self.frame, self._velocities, *[state[1] for state in states])
        return self.frame


class RangeTemplate(Stamped):
    """sensor_msgs/Range."""

    def __init__(self, config: SonarSensor, frame: str) -> None:
        """Takes the sonar's settings and the frame id."""
        kind = Range.INFRARED if config.radiation == "infrared" else Range.ULTRASOUND
        message = Range(radiation_type=kind, field_of_view=config.fov)
        message.min_range, message.max_range = config.min_range, config.max_range
        message.header.frame_id = frame
        super().__init__(message)

    def fill(self, time: int, distance: float) -> bytearray:
        """Returns the frame for a time [ns] and a range [m]."""
        self.stamp(time)
        struct.pack_into("<f", self.frame, len(self.frame) - 4, distance)
        return self.frame


ENCODINGS = {
    "R8G8B8": "rgb8", "RGB_INT8": "rgb8", "B8G8R8": "bgr8", "BGR_INT8": "bgr8", "L8": "mono8", "L_INT8": "mono8",
}  # fmt: skip
"""Maps SDF's pixel formats to encodings of sensor_msgs/Image."""


def image_of(picture: Picture, config: Camera) -> Image:
    """Returns the Image of a picture (height, width, 3) in the camera's format, without a header."""
    encoding = ENCODINGS[config.format]
    if encoding == "mono8":
        picture = (picture @ (0.299, 0.587, 0.114)).astype("u1")
    elif encoding == "bgr8":
        picture = picture[:, :, ::-1]
    step = config.width * (1 if encoding == "mono8" else 3)
    return Image(
        height=config.height,
        width=config.width,
        encoding=encoding,
        step=step,
        data=picture.tobytes(),
    )


def depth_of(depth: Depth) -> Image:
    """Returns the Image of a depth picture [m], without a header."""
    height, width = depth.shape
    return Image(height=height, width=width, encoding="32FC1", step=4 * width, data=depth.tobytes())


def cloud_of(points: NDArray[np.float32]) -> PointCloud2:
    """Returns the PointCloud2 of points, shape (height, width, 3), without a header."""
    height, width, _ = points.shape
    fields = [
        PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate("xyz")
    ]
    return PointCloud2(
        height=height, width=width, fields=fields, point_step=12, row_step=12 * width, data=points.tobytes(),
        is_dense=False,
    )  # fmt: skip


def info_of(config: Camera) -> CameraInfo:
    """Returns the CameraInfo of a camera without distortion, without a header."""
    lens = intrinsics_of(config)
    matrix = [lens.focal, 0.0, lens.x, 0.0, lens.focal, lens.y, 0.0, 0.0, 1.0]
    return CameraInfo(
        height=config.height,
        width=config.width,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=matrix,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[*matrix[:3], -lens.focal * config.hack_baseline, *matrix[3:6], 0.0, *matrix[6:], 0.0],
    )
