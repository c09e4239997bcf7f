import zlib
from io import BytesIO

import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from rocon_relay.sieve import (
    MOST_KINDS,
    DeflatedError,
    Pace,
    StampPace,
    deflated,
    inflated,
    matching_transforms,
)


def serialised(*frames):
    buffer = BytesIO()
    transforms = [TransformStamped(child_frame_id=frame) for frame in frames]
    for number, one in enumerate(transforms):
        one.header.frame_id = "map" * number
        one.transform.translation.x = number
    TFMessage(transforms).serialize(buffer)
    return buffer.getvalue()


a_name = st.text("ab/é", max_size=5)
names = st.lists(a_name, max_size=6)


@given(names, st.sets(a_name, max_size=3))
def test_transforms_that_match_are_kept_as_they_were(frames, others):
    wanted = {*frames[::2], *others}
    kept = matching_transforms(memoryview(serialised(*frames)), wanted.__contains__)
    whole = TFMessage().deserialize(serialised(*frames)).transforms
    expected = [one for one in whole if one.child_frame_id in wanted]
    assert (TFMessage().deserialize(kept).transforms if kept else []) == expected


@given(names, st.integers(min_value=0, max_value=300), st.binary(max_size=8))
def test_what_is_no_tf_message_is_left_out_and_raises_nothing(frames, cut, garbage):
    data = serialised(*frames)
    matching_transforms(memoryview(data[:cut] + garbage), lambda _frame: True)
    assert matching_transforms(memoryview(data[: len(data) // 2]), lambda _frame: True) is None


@given(st.binary(max_size=2000))
def test_what_is_compressed_comes_back(message):
    assert inflated(memoryview(deflated(memoryview(message))), 2000) == message


def test_what_is_not_compressed_as_it_should_be_is_an_error():
    bomb = zlib.compress(bytes(10_000_000))
    for bad in (
        b"",
        b"garbage",
        deflated(memoryview(b"message"))[:-1],
        deflated(memoryview(b"m")) + b"more",
        bomb,
    ):
        with pytest.raises(DeflatedError):
            inflated(memoryview(bad), 1_000_000)


def test_a_pace_spaces_messages_by_its_period():
    pace = Pace(10.0)
    assert pace.wait(5.0) == 0.0
    pace.went(5.0)
    assert pace.wait(5.04) == pytest.approx(0.06)
    assert pace.wait(5.1) == pytest.approx(0.0)
    assert pace.wait(9.0) == 0.0


def _stamped(type_, seconds):
    stamp, buffer = rospy.Time(0, round(seconds * 1e9)), BytesIO()
    message = Clock(stamp) if type_ == "rosgraph_msgs/Clock" else Odometry()
    if type_ == "tf2_msgs/TFMessage":
        message = TFMessage([TransformStamped()])
        message.transforms[0].header.stamp = stamp
    elif type_ == "nav_msgs/Odometry":
        message.header.stamp = stamp
    message.serialize(buffer)
    return memoryview(buffer.getvalue())


@pytest.mark.parametrize(
    "type_", ["rosgraph_msgs/Clock", "tf2_msgs/TFMessage", "nav_msgs/Odometry"]
)
def test_of_each_period_of_stamps_the_first_message_goes(type_):
    pace = StampPace(20.0, type_)
    times = [1.0, 1.01, 1.04, 1.05, 1.06, 1.09, 1.2, 1.24, 0.0, 0.01, 0.05]
    assert [one for one in times if pace.picks(_stamped(type_, one))] == [1.0, 1.05, 1.2, 0.0, 0.05]


def _of_frames(nanoseconds, *children):
    message, buffer = (
        TFMessage([TransformStamped(child_frame_id=child) for child in children]),
        BytesIO(),
    )
    for one in message.transforms:
        one.header.stamp = rospy.Time(0, nanoseconds)
    message.serialize(buffer)
    return memoryview(buffer.getvalue())


def _goes(pace, message):
    return pace.picks(message, pace.kind(message))


def test_frames_in_messages_of_their_own_do_not_keep_each_other_back():
    pace = StampPace(20.0, "tf2_msgs/TFMessage")
    sent = [(child, stamp) for stamp in (1, 2, 60_000_000) for child in ("arm", "odom", "wheel")]
    went = [(child, stamp) for child, stamp in sent if _goes(pace, _of_frames(stamp, child))]
    assert went == [
        (child, stamp) for stamp in (1, 60_000_000) for child in ("arm", "odom", "wheel")
    ]


def test_a_frame_that_comes_less_often_than_another_of_its_message_is_not_left_out():
    """At 25 Hz, throttled to 20 Hz, it once coincided with the first message of a period only every 0.2 s."""
    pace, times = StampPace(20.0, "tf2_msgs/TFMessage"), range(10, 1010, 10)
    frames = {ms: ("fast", *(("slow",) if ms % 40 == 0 else ())) for ms in times}
    assert (
        sum(
            _goes(pace, _of_frames(ms * 10**6, *frames[ms])) and len(frames[ms]) > 1 for ms in times
        )
        >= 20
    )


def test_kinds_without_end_take_bounded_memory():
    pace = StampPace(20.0, "tf2_msgs/TFMessage")
    assert all(_goes(pace, _of_frames(1, f"ghost{number}")) for number in range(3 * MOST_KINDS))
    assert len(pace._last) <= MOST_KINDS


@pytest.mark.parametrize(
    "type_", ["rosgraph_msgs/Clock", "tf2_msgs/TFMessage", "nav_msgs/Odometry"]
)
def test_a_message_without_a_stamp_goes(type_):
    pace = StampPace(20.0, type_)
    assert all(_goes(pace, _stamped(type_, 0.0)) for _ in range(3))


@given(st.binary(max_size=60))
def test_what_is_no_tf_message_is_picked_or_not_and_raises_nothing(data):
    _goes(StampPace(20.0, "tf2_msgs/TFMessage"), memoryview(data))


def test_a_message_too_short_for_a_stamp_goes():
    assert StampPace(20.0, "std_msgs/Empty").picks(memoryview(b""))
