"""tf messages as bytes."""

import io
import random
import struct

import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from pioneer_ros2.transform import (
    StaticFrames,
    by_robot,
    in_own_frames,
    message_of,
    transforms_in,
)


def encoded(*frames: tuple[str, str, float]) -> bytes:
    """Returns a TFMessage of transforms with these parents, children and x."""
    message = TFMessage()
    for parent, child, x in frames:
        transform = TransformStamped()
        transform.header.frame_id = parent
        transform.child_frame_id = child
        transform.transform.translation.x = x
        transform.transform.rotation.w = 1.0
        message.transforms.append(transform)
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def decoded(data: bytes) -> list[tuple[str, str, float]]:
    message = TFMessage().deserialize(data)
    return [
        (each.header.frame_id, each.child_frame_id, each.transform.translation.x)
        for each in message.transforms
    ]


def test_what_is_read_is_written_again() -> None:
    data = encoded(("map", "p1/odom", 1.0), ("", "größe", 2.0))
    assert message_of(transforms_in(data)) == data


def test_each_robot_s_transforms_lose_its_prefix() -> None:
    data = encoded(
        ("map", "p1/odom", 1.0), ("p1/odom", "p1/base_link", 2.0), ("map", "p10/odom", 3.0)
    )
    robots = {robot: decoded(message_of(found)) for robot, found in by_robot(data).items()}
    assert robots == {
        "p1": [("map", "odom", 1.0), ("odom", "base_link", 2.0)],
        "p10": [("map", "odom", 3.0)],
    }


def test_a_frame_without_prefix_belongs_to_no_robot() -> None:
    assert by_robot(encoded(("map", "odom", 1.0))) == {}


def test_static_frames_of_several_publishers_are_kept_the_newest_of_each() -> None:
    statics = StaticFrames()
    statics.merged(encoded(("a", "b", 1.0)))
    statics.merged(encoded(("c", "d", 2.0)))
    assert decoded(statics.merged(encoded(("a", "b", 3.0)))) == [("a", "b", 3.0), ("c", "d", 2.0)]


def test_a_message_cut_short_anywhere_is_an_error() -> None:
    data = encoded(("map", "p1/odom", 1.0), ("p1/odom", "p1/base_link", 2.0))
    for length in range(len(data)):
        with pytest.raises((struct.error, UnicodeDecodeError)):
            list(transforms_in(data[:length]))


def test_random_bytes_are_an_error_or_transforms() -> None:
    source = random.Random(43)
    for _ in range(2000):
        data = source.randbytes(source.randint(0, 200))
        try:
            list(transforms_in(data))
        except (struct.error, UnicodeDecodeError):
            continue


def bytes_of(message: LaserScan | Odometry) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("frame", "own"),
    [("p1/laser", "laser"), ("p2/laser", "p2/laser"), ("", ""), ("p1/größe", "größe")],
)
def test_a_robot_s_own_prefix_is_taken_off_a_scan_and_nothing_else_changes(
    frame: str, own: str
) -> None:
    scan = LaserScan(range_max=30.0, ranges=[1.0, 2.5])
    scan.header.seq = 7
    scan.header.frame_id = frame
    found = LaserScan().deserialize(in_own_frames(bytes_of(scan), "p1", 1))
    scan.header.frame_id = own
    assert bytes_of(found) == bytes_of(scan)


def test_odometry_loses_the_prefix_of_both_frames() -> None:
    odometry = Odometry(child_frame_id="p1/base_link")
    odometry.header.frame_id = "p1/odom"
    odometry.pose.pose.position.x = 1.5
    found = Odometry().deserialize(in_own_frames(memoryview(bytes_of(odometry)), "p1", 2))
    frames = (found.header.frame_id, found.child_frame_id)
    assert (frames, found.pose.pose.position.x) == (("odom", "base_link"), 1.5)


@pytest.mark.parametrize("size", [0, 11, 15, 17])
def test_a_message_that_ends_within_its_frame_is_an_error(size: int) -> None:
    scan = LaserScan()
    scan.header.frame_id = "p1/laser"
    with pytest.raises(struct.error):
        in_own_frames(bytes_of(scan)[:size], "p1", 1)
