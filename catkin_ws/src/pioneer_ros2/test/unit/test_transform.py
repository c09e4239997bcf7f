"""tf messages as bytes."""

import io
import random
import struct

import pytest
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from pioneer_ros2.transform import StaticFrames, by_robot, message_of, transforms_in


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
