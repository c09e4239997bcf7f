"""What new subscribers of a latched topic get first."""

from io import BytesIO

from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from tf2_msgs.msg import TFMessage

from rocon_relay.latch import MAX_BYTES, TransformLatch, latch_for
from rocon_relay.sieve import whole_frame
from tcpros.fanout import Latch


def frame_of(number: int, children: list[str]) -> memoryview:
    """Returns a tf message whose transforms all have the translation x = `number`."""
    message = TFMessage([TransformStamped(child_frame_id=child) for child in children])
    for one in message.transforms:
        one.transform.translation.x = number
    written = BytesIO()
    message.serialize(written)
    return whole_frame(written.getvalue()).data


def seen_by_a_newcomer(latch: Latch) -> dict[str, float]:
    """Returns x of each child frame in the buffer of a new tf listener."""
    found = {}
    for frame in latch.frames:
        for one in TFMessage().deserialize(frame[4:].tobytes()).transforms:
            found[one.child_frame_id] = one.transform.translation.x
    return found


messages = st.lists(st.lists(st.sampled_from("abcde"), max_size=3), max_size=20)


@given(messages)
def test_a_newcomer_sees_the_last_transform_of_each_frame(drawn):
    latch, expected = latch_for("tf2_msgs/TFMessage"), {}
    for number, children in enumerate(drawn):
        latch.keep(frame_of(number, children))
        expected |= dict.fromkeys(children, float(number))
    assert seen_by_a_newcomer(latch) == expected
    assert len(latch.frames) <= len(expected), "what is replaced is dropped"


def test_frames_that_never_come_again_do_not_fill_the_memory():
    latch = TransformLatch()
    name = "x" * 50_000
    for number in range(200):
        latch.keep(frame_of(number, [f"{number}{name}"]))
    assert 0 < sum(map(len, latch.frames)) <= MAX_BYTES
    assert f"199{name}" in seen_by_a_newcomer(latch), "the newest stays"


def test_other_types_and_malformed_messages_keep_the_last_or_nothing():
    latch = latch_for("std_msgs/String")
    for text in (b"one", b"two"):
        latch.keep(memoryview(text))
    assert latch.frames == [b"two"]
    transforms = TransformLatch()
    transforms.keep(frame_of(1, ["a"]))
    for wrong in (b"", b"\x04\0\0\0\xff\xff\xff\xff", b"\x04\0\0\0\0\0\0\0"):
        transforms.keep(memoryview(wrong))
    assert seen_by_a_newcomer(transforms) == {"a": 1.0}
