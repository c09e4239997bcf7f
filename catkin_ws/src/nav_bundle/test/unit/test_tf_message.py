"""Transforms are picked out of serialised messages without unpacking the rest."""

import io

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from nav_bundle.adapters.tf_message import StampedTransform, TransformPicker, transforms_of
from nav_bundle.core.transform import Transform


def serialised(*edges: tuple[str, str, float]) -> bytes:
    message = TFMessage()
    for parent, child, x in edges:
        transform = TransformStamped(child_frame_id=child)
        transform.header.frame_id = parent
        transform.header.stamp.secs, transform.header.stamp.nsecs = 3, 500_000_000
        transform.transform.translation.x = x
        transform.transform.rotation.w = 1.0
        message.transforms.append(transform)
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def record(parent: str, child: str, x: float) -> StampedTransform:
    return StampedTransform(parent, child, 3.5, Transform((x, 0.0, 0.0)))


def fleet(x: float) -> bytes:
    return serialised(*((f"pioneer{i}/odom", f"pioneer{i}/base_link", x + i) for i in range(1, 51)))


def test_every_transform_of_a_message_is_read() -> None:
    assert list(transforms_of(serialised(("map", "odom", 1), ("/odom", "/base_link", 2)))) == [
        record("map", "odom", 1),
        record("odom", "base_link", 2),
    ]
    assert list(transforms_of(serialised())) == []


def test_only_watched_frames_are_picked_first_and_later() -> None:
    picker = TransformPicker()
    picker.watch({"pioneer5/base_link"})
    for x in (0.0, 7.0):
        assert picker.pick(fleet(x)) == [record("pioneer5/odom", "pioneer5/base_link", x + 5)]


def test_a_frame_that_is_only_a_parent_is_not_picked() -> None:
    picker = TransformPicker()
    picker.watch({"base_link"})
    assert picker.pick(serialised(("base_link", "wheel", 1))) == []
    assert picker.pick(serialised(("odom", "base_link", 1))) == [record("odom", "base_link", 1)]
    assert picker.pick(serialised(("base_link", "wheel", 1))) == []


def test_a_name_with_a_leading_slash_is_the_same_frame() -> None:
    picker = TransformPicker()
    picker.watch({"base_link"})
    for _ in range(2):
        assert picker.pick(serialised(("/odom", "/base_link", 4))) == [record("odom", "base_link", 4)]


def test_a_frame_repeated_in_a_message_is_picked_each_time() -> None:
    picker = TransformPicker()
    picker.watch({"b"})
    for _ in range(2):
        assert picker.pick(serialised(("a", "b", 1), ("x", "y", 0), ("a", "b", 2))) == [
            record("a", "b", 1),
            record("a", "b", 2),
        ]


def test_a_new_parent_is_learned_when_the_watch_is_set_again() -> None:
    picker = TransformPicker()
    picker.watch({"b"})
    picker.pick(serialised(("a", "b", 1)))
    assert picker.pick(serialised(("c", "b", 1))) == []
    picker.watch({"b"})
    assert picker.pick(serialised(("c", "b", 1))) == [record("c", "b", 1)]
