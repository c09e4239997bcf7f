"""Transforms are picked out of serialised messages without unpacking the rest."""

import io
import math

import pytest
from genpy import DeserializationError
from geometry_msgs.msg import TransformStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from tf2_msgs.msg import TFMessage

from nav_bundle.base.tf_message import StampedTransform, TransformPicker, transforms_of
from nav_bundle.base.transform import Transform, fault_of
from pioneer_node.core.frame import stripped


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
    assert transforms_of(
        serialised(("map", "odom", 1), ("/odom", "/base_link", 2)), pytest.fail
    ) == [
        record("map", "odom", 1),
        record("odom", "base_link", 2),
    ]
    assert transforms_of(serialised(), pytest.fail) == []


def test_only_watched_frames_are_picked_first_and_later() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"pioneer5/base_link"})
    for x in (0.0, 7.0):
        assert picker.pick(fleet(x)) == [record("pioneer5/odom", "pioneer5/base_link", x + 5)]


def test_a_frame_that_is_only_a_parent_is_not_picked() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"base_link"})
    assert picker.pick(serialised(("base_link", "wheel", 1))) == []
    assert picker.pick(serialised(("odom", "base_link", 1))) == [record("odom", "base_link", 1)]
    assert picker.pick(serialised(("base_link", "wheel", 1))) == []


def test_a_name_with_a_leading_slash_is_the_same_frame() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"base_link"})
    for _ in range(2):
        assert picker.pick(serialised(("/odom", "/base_link", 4))) == [
            record("odom", "base_link", 4)
        ]


def test_a_frame_repeated_in_a_message_is_picked_each_time() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"b"})
    for _ in range(2):
        assert picker.pick(serialised(("a", "b", 1), ("x", "y", 0), ("a", "b", 2))) == [
            record("a", "b", 1),
            record("a", "b", 2),
        ]


def test_a_new_parent_is_learned_when_the_watch_is_set_again() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"b"})
    picker.pick(serialised(("a", "b", 1)))
    assert picker.pick(serialised(("c", "b", 1))) == []
    picker.watch({"b"})
    assert picker.pick(serialised(("c", "b", 1))) == [record("c", "b", 1)]


def unpacked(buffer: bytes) -> list[StampedTransform]:
    """Returns the transforms that genpy finds in a message, without those that no tf tree accepts."""
    found = []
    for each in TFMessage().deserialize(buffer).transforms:
        place, turn = each.transform.translation, each.transform.rotation
        transform = Transform((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))
        parent, child = stripped(each.header.frame_id), stripped(each.child_frame_id)
        if not fault_of(parent, child, transform):
            found.append(StampedTransform(parent, child, each.header.stamp.to_sec(), transform))
    return found


NAMES = st.sampled_from(["", "\0", "a", "b", "/b", "base_link", "\x01\0\0\0b", "ä", "a" * 300])
EDGES = st.lists(st.tuples(NAMES, NAMES, st.floats(width=32)), max_size=4)


@st.composite
def hostile(draw: st.DrawFn) -> bytes:
    """Draws a message with some bytes replaced, removed, inserted or cut off, or arbitrary bytes."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    buffer = bytearray(serialised(*draw(EDGES)))
    for _ in range(draw(st.integers(0, 3))):
        begin = draw(st.integers(0, len(buffer)))
        length = draw(st.integers(0, 8))
        other = st.sampled_from([b"\x01\0\0\0b", b"\xff\xff\xff\xff", b"\0\0\0\0", b"base_link"])
        buffer[begin : begin + length] = draw(st.binary(max_size=6) | other)
    return bytes(buffer)


@given(EDGES, st.frozensets(NAMES.map(stripped), min_size=1))
def test_valid_messages_give_what_full_deserialisation_gives(
    edges: list[tuple[str, str, float]], watched: frozenset[str]
) -> None:
    picker = TransformPicker(lambda _: None)
    picker.watch(watched)
    for _ in range(2):
        message = serialised(*edges)
        assert picker.pick(message) == [each for each in unpacked(message) if each.child in watched]
        assert transforms_of(message, lambda _: None) == unpacked(message)


@settings(max_examples=400)
@given(st.lists(hostile(), min_size=1, max_size=3), st.frozensets(NAMES.map(stripped), min_size=1))
def test_hostile_bytes_cost_no_more_than_their_own_message(
    buffers: list[bytes], watched: frozenset[str]
) -> None:
    refused: list[str] = []
    picker = TransformPicker(refused.append)
    picker.watch(watched)
    for buffer in buffers:
        refused.clear()
        picked = picker.pick(buffer)
        try:
            whole = [each for each in unpacked(buffer) if each.child in watched]
        except DeserializationError:
            assert picked == []
            continue
        # Full deserialisation replaces bytes that are not UTF-8, and the picker learns a child's second parent only
        # with the next ``watch``.
        assert set(map(repr, picked)) <= set(map(repr, whole))
        if buffer is buffers[0] and not refused:
            assert picked == whole
    good = serialised(("a", "base_link", 1.0))
    picker.watch({"base_link"})
    assert picker.pick(good) == [record("a", "base_link", 1.0)]


def test_an_empty_frame_name_does_not_break_later_messages() -> None:
    refused: list[str] = []
    picker = TransformPicker(refused.append)
    picker.watch({"", "base_link"})
    assert picker.pick(serialised(("", "", 1))) == []
    assert "name is empty" in refused[0]
    assert picker.pick(serialised(("odom", "base_link", 1))) == [record("odom", "base_link", 1)]


def test_a_name_inside_of_another_field_is_not_picked() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"b"})
    picker.pick(serialised(("a", "b", 1)))
    assert picker.pick(serialised(("a", "c\x01\0\0\0a\x01\0\0\0b", 1))) == []


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_transform_that_is_not_finite_is_dropped_alone(number: float) -> None:
    refused: list[str] = []
    picker = TransformPicker(refused.append)
    picker.watch({"b", "d"})
    assert picker.pick(serialised(("a", "b", number), ("c", "d", 1))) == [record("c", "d", 1)]
    assert "finite" in refused[0]


def test_a_quaternion_without_length_is_refused() -> None:
    assert "length 1" in fault_of("a", "b", Transform(rotation=(0.0, 0.0, 0.0, 0.0)))
    assert fault_of("a", "b", Transform()) == ""


@pytest.mark.parametrize("parent", ["odom_combined", "/odom", "map"])
def test_a_frame_with_a_new_parent_is_followed(parent: str) -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"base_link", "odom"})
    assert picker.pick(serialised(("odom", "base_link", 1)))
    picked = [picker.pick(serialised((parent, "base_link", x))) for x in range(40)]
    assert picked[-1] == [record(stripped(parent), "base_link", 39)]
    assert all(picked[20:])


def test_a_frame_that_is_also_the_parent_of_others_is_not_parsed_for_them() -> None:
    picker = TransformPicker(pytest.fail)
    picker.watch({"base_link"})
    for _ in range(50):
        assert picker.pick(serialised(("odom", "base_link", 1)))
        assert not picker._concerns(serialised(("base_link", "wheel", 1)))
