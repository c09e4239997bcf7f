"""Messages of every standard type, there and back, drawn at random."""

import io
import random
import re
from typing import Any

import genpy
import pytest
import roslib.message

pytest.importorskip("rosbags", reason="the door to ROS 2 is not installed")

from rosbags.typesys import Stores, get_typestore

from pioneer_ros2.error import TypeUnknownError
from pioneer_ros2.message import MessageTypes

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
