"""A template's frame has the bytes that rospy would have serialised."""

import io
import math
import struct
from typing import Any

import genpy
import numpy as np
import pytest
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan, Range
from tf2_msgs.msg import TFMessage

from pioneer_gazebo.laser.laser import Laser
from pioneer_gazebo.noise import Noise
from pioneer_gazebo.physics.engine import STILL, Velocity
from pioneer_gazebo.ros import messages
from pioneer_gazebo.topics import drive_messages, sensor_messages
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import LaserSensor, SonarSensor

TIME = 12_340_000_000


def read(kind: type, frame: bytes | bytearray) -> Any:
    (length,) = struct.unpack_from("<I", frame)
    assert length == len(frame) - 4
    message = kind().deserialize(bytes(frame[4:]))
    buffer = io.BytesIO()
    message.serialize(buffer)
    assert buffer.getvalue() == bytes(frame[4:])
    return message


def test_odometry() -> None:
    template = drive_messages.OdometryTemplate(
        "r/odom", "r/base_link", [1, 2, 3, 4, 5, 6], [6, 5, 4, 3, 2, 1]
    )
    template.fill(0, Pose(), STILL)
    pose = Pose.from_rpy(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    message = read(Odometry, template.fill(TIME, pose, Velocity((0.5, 0.1, 0.2), (0.3, 0.4, 0.6))))
    assert (message.header.seq, message.header.frame_id, message.child_frame_id) == (
        1,
        "r/odom",
        "r/base_link",
    )
    assert message.header.stamp == genpy.Time(12, 340_000_000)
    assert messages.pose_from_message(message.pose.pose).rotation == pytest.approx(pose.rotation)
    assert (message.twist.twist.linear.x, message.twist.twist.angular.z) == (0.5, 0.6)
    assert message.pose.covariance[0::7] == (1, 2, 3, 4, 5, 6)
    assert message.twist.covariance[0::7] == (6, 5, 4, 3, 2, 1)


def test_scan() -> None:
    config = LaserSensor("laser", "laser", samples=5, max_range=8.0)
    ranges = np.array([1.0, 2.0, np.inf, -np.inf, 3.5])
    laser = Laser(config, Noise(0))
    template = sensor_messages.ScanTemplate(config, "r/laser", laser)
    message = read(LaserScan, template.fill(TIME, ranges))
    assert message.ranges == tuple(ranges)
    assert (message.range_max, message.angle_increment) == (8.0, pytest.approx(math.pi / 4))


def test_joint_states() -> None:
    message = read(
        JointState,
        sensor_messages.JointStateTemplate(["a", "bb"]).fill(TIME, [(1.0, 2.0), (3.0, 4.0)]),
    )
    assert (message.name, message.position, message.velocity) == (
        ["a", "bb"],
        (1.0, 3.0),
        (2.0, 4.0),
    )


def test_range() -> None:
    message = read(
        Range, sensor_messages.RangeTemplate(SonarSensor("s", "s"), "r/s").fill(TIME, 1.5)
    )
    assert (message.range, message.header.frame_id) == (1.5, "r/s")


def test_transforms() -> None:
    first = messages.TransformTemplate("a/odom", "a/base_link").fill(TIME, Pose((1.0, 2.0, 3.0)))
    second = messages.TransformTemplate("b/odom", "b/base_link").fill(TIME, Pose())
    message = read(TFMessage, messages.transforms_frame([first, second]))
    expected = TransformStamped(transform=Transform(Vector3(1, 2, 3), Quaternion(0, 0, 0, 1)))
    assert message.transforms[0].transform == expected.transform
    assert [one.child_frame_id for one in message.transforms] == ["a/base_link", "b/base_link"]


def test_clock() -> None:
    assert read(Clock, messages.clock_frame(TIME)).clock == genpy.Time(12, 340_000_000)


def test_a_pose_message_that_is_not_finite_is_refused_and_an_empty_one_means_no_turn() -> None:
    assert messages.pose_from_message(PoseMessage()) == Pose()
    with pytest.raises(ValueError, match="not finite"):
        messages.pose_from_message(PoseMessage(orientation=Quaternion(0, 0, 0, float("nan"))))
