"""Messages of every standard type, there and back, drawn at random."""

import io
import random
import re
import struct
from typing import Any

import genpy
import pytest
import roslib.message

pytest.importorskip("rosbags", reason="the door to ROS 2 is not installed")

from rosbags.typesys import Stores, get_typestore

from pioneer_ros2.error import TypeUnknownError
from pioneer_ros2.message import RELEASES, MessageTypes
from pioneer_ros2.transcoder import MalformedError

ROUNDS = 20
PACKAGES = (
    "std_msgs", "geometry_msgs", "sensor_msgs", "nav_msgs", "tf2_msgs", "rosgraph_msgs", "diagnostic_msgs",
    "visualization_msgs", "actionlib_msgs", "trajectory_msgs",
)  # fmt: skip
CUSTOM = """Header header
Leg[] legs
time last
bool[3] down
{line}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
{line}
MSG: walker_msgs/Leg
string name
float64[2] reach
""".format(line="=" * 80)


def standard_types() -> list[str]:
    """Returns the types that both sides have, and that are installed here."""
    ours = get_typestore(Stores.ROS1_NOETIC).fielddefs
    theirs = get_typestore(Stores.ROS2_KILTED).fielddefs
    names = (
        name.replace("/msg/", "/")
        for name in sorted(set(ours) & set(theirs))
        if name.split("/")[0] in PACKAGES
    )
    return [name for name in names if roslib.message.get_message_class(name)]


def fill(value: Any, source: random.Random) -> Any:
    """Gives a message random values, and returns it."""
    for name, kind in zip(value.__slots__, value._slot_types, strict=True):
        setattr(value, name, drawn(kind, source))
    return value


def drawn(kind: str, source: random.Random) -> Any:
    base, bracket, length = kind.partition("[")
    if bracket:
        count = int(length[:-1]) if length != "]" else source.randint(0, 3)
        values = [drawn(base, source) for _ in range(count)]
        return bytes(values) if base in ("uint8", "char") else values
    if base == "string":
        return "".join(source.choice("aä/_ 9") for _ in range(source.randint(0, 6)))
    if base == "bool":
        return source.random() < 0.5
    if base in ("float32", "float64"):
        return source.choice([0.0, -1.5, 0.25, 2.0**20])
    if base == "time":
        return genpy.Time(source.randint(0, 2**31 - 1), source.randint(0, 999_999_999))
    if base == "duration":
        return genpy.Duration(source.randint(-9, 9), source.randint(0, 999_999_999))
    number = re.fullmatch(r"(?:byte|char|u?int(\d+))", base)
    if number:
        bits = int(number[1] or 8)
        signed = base.startswith("int") or base == "byte"
        low = -(2 ** (bits - 1)) if signed else 0
        return source.randint(low, low + 2**bits - 1)
    if base == "Header":
        base = "std_msgs/Header"
    return fill(roslib.message.get_message_class(base)(), source)


def encoded(message: Any) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def without_sequence(message: Any) -> Any:
    """Returns the message with every ``Header.seq`` 0, which ROS 2 does not carry."""
    if isinstance(message, genpy.Message):
        if message._type == "std_msgs/Header":
            message.seq = 0
        for name in message.__slots__:
            without_sequence(getattr(message, name))
    elif isinstance(message, list):
        for each in message:
            without_sequence(each)
    return message


@pytest.fixture(scope="module")
def messages() -> MessageTypes:
    return MessageTypes()


def random_message(name: str, source: random.Random) -> Any:
    return fill(roslib.message.get_message_class(name)(), source)


@pytest.mark.parametrize("name", standard_types())
def test_random_messages_of_a_standard_type_come_back_as_they_went(
    messages: MessageTypes, name: str
) -> None:
    source = random.Random(name)
    converter = messages.converter(name)
    for _ in range(ROUNDS):
        message = fill(roslib.message.get_message_class(name)(), source)
        back = type(message)().deserialize(converter.to_ros1(converter.to_cdr(encoded(message))))
        assert encoded(without_sequence(back)) == encoded(without_sequence(message))


def test_a_type_that_differs_in_ros_2_says_in_which_fields(messages: MessageTypes) -> None:
    converter = messages.converter("sensor_msgs/Range")
    assert (converter.only_ros1, converter.only_ros2) == ((), ("variance",))
    assert "texture.data" in messages.converter("visualization_msgs/Marker").only_ros2


def test_a_custom_type_is_converted_by_the_definition_that_its_publisher_sends(
    messages: MessageTypes,
) -> None:
    converter = messages.converter("walker_msgs/Walker", CUSTOM)
    assert converter.type_hash.startswith("RIHS01_")
    header = b"\0" * 12 + b"\4\0\0\0base"
    leg = b"\4\0\0\0left" + b"\0" * 16
    message = header + b"\1\0\0\0" + leg + b"\5\0\0\0\6\0\0\0" + b"\1\0\1"
    assert converter.to_ros1(converter.to_cdr(message)) == message


@pytest.mark.parametrize("definition", ["", "float99 x", "Leg leg"])
def test_a_type_without_a_definition_that_can_be_read_is_named(
    messages: MessageTypes, definition: str
) -> None:
    with pytest.raises(TypeUnknownError, match="walker_msgs/Unknown"):
        messages.converter("walker_msgs/Unknown", definition)


@pytest.mark.parametrize("release", RELEASES)
def test_what_a_release_of_ros_2_gets_has_its_published_layout(release: str) -> None:
    """The independent decoder has the definitions that each release published."""
    messages = MessageTypes(release)
    store = get_typestore(RELEASES[release])
    source = random.Random(release)
    for name in standard_types():
        converter = messages.converter(name)
        message = random_message(name, source)
        cdr = converter.to_cdr(encoded(message))
        decoded = store.deserialize_cdr(cdr, name.replace("/", "/msg/"))
        # Its own encoding of what it has read is the same: nothing was misread.
        assert bytes(store.serialize_cdr(decoded, name.replace("/", "/msg/"))) == cdr
        back = type(message)().deserialize(converter.to_ros1(cdr))
        assert encoded(without_sequence(back)) == encoded(without_sequence(message))


def test_of_the_standard_types_only_the_range_differs_between_releases() -> None:
    extra = {
        release: {name: types.converter(name).only_ros2 for name in standard_types()}
        for release, types in {release: MessageTypes(release) for release in RELEASES}.items()
    }
    assert extra["jazzy"] == extra["kilted"] == extra["iron"]
    differing = {name for name in extra["kilted"] if extra["humble"][name] != extra["kilted"][name]}
    assert differing == {"sensor_msgs/Range"}


def test_conversions_are_those_of_rosbags_where_both_sides_have_the_same_fields(
    messages: MessageTypes,
) -> None:
    store = get_typestore(Stores.ROS2_KILTED)
    source = random.Random(7)
    for name in standard_types():
        converter = messages.converter(name)
        if converter.only_ros1 or converter.only_ros2:
            continue
        message = encoded(random_message(name, source))
        assert converter.to_cdr(message) == bytes(
            store.ros1_to_cdr(message, name.replace("/", "/msg/"))
        )


@pytest.mark.parametrize(
    "name", ["sensor_msgs/PointCloud", "visualization_msgs/Marker", "tf2_msgs/TFMessage"]
)
def test_a_message_cut_short_or_garbled_is_malformed_or_another_message(
    messages: MessageTypes, name: str
) -> None:
    source = random.Random(name)
    definition = roslib.message.get_message_class(name)._full_text
    converter = messages.converter(name, definition)
    whole = encoded(random_message(name, source))
    for convert, data in ((converter.to_cdr, whole), (converter.to_ros1, converter.to_cdr(whole))):
        for _ in range(500):
            garbled = bytearray(data[: source.randint(0, len(data))])
            for _ in range(source.randint(0, 4)):
                if garbled:
                    garbled[source.randrange(len(garbled))] = source.randrange(256)
            try:
                convert(bytes(garbled))
            except (MalformedError, struct.error):
                continue


def test_a_message_with_more_bytes_than_fields_is_malformed(messages: MessageTypes) -> None:
    converter = messages.converter("geometry_msgs/Twist")
    with pytest.raises(MalformedError, match="end after 48 of 56 bytes"):
        converter.to_cdr(bytes(56))


@pytest.mark.parametrize("name", standard_types())
def test_the_checksum_of_a_type_is_ros_1_s(messages: MessageTypes, name: str) -> None:
    assert messages.ros1_kind(name)._md5sum == roslib.message.get_message_class(name)._md5sum


@pytest.mark.parametrize(
    ("type_name", "count"),
    [("sensor_msgs/LaserScan", 1), ("nav_msgs/Odometry", 2), ("geometry_msgs/Twist", 0)],
)
def test_a_type_s_leading_frames_are_known_by_its_definition(type_name: str, count: int) -> None:
    messages = MessageTypes()
    messages.converter(type_name)
    assert messages.leading_frames(type_name) == count
