"""When the frames of joints are due, and how a JointState is read."""

import io
import random
import struct

import pytest
from sensor_msgs.msg import JointState

from pioneer_description.conversions import MalformedMessageError, joint_positions
from pioneer_description.core.joint_frames import JointFrames
from pioneer_gazebo.world.joint import CONTINUOUS, FIXED, FLOATING, PRISMATIC, Joint
from pioneer_gazebo.world.pose import Pose

PERIOD = 100
JOINTS = (
    Joint("turn", CONTINUOUS, "base", "turret", axis=(0.0, 0.0, 1.0)),
    Joint("push", PRISMATIC, "turret", "slide", Pose((1.0, 0.0, 0.0)), axis=(0.0, 1.0, 0.0)),
    Joint("hold", FIXED, "slide", "tool"),
    Joint("free", FLOATING, "base", "ball"),
)


def test_only_joints_that_a_position_moves_are_published_with_it() -> None:
    frames = JointFrames(JOINTS, PERIOD)
    assert [joint.name for joint in frames.fixed] == ["hold"]
    assert frames.due(0, ["free", "push", "hold", "unknown", "turn"]) == ("push", "turn")
    assert frames.due(0, ["free", "unknown"]) == ()
    assert frames.due(0, []) == ()


def test_a_joint_is_due_once_a_period_and_when_its_time_goes_back() -> None:
    frames = JointFrames(JOINTS, PERIOD)
    times = [1000, 1050, 1099, 1100, 1199, 1200, 50, 60, 149, 150]
    assert [bool(frames.due(time, ["turn"])) for time in times] == [
        True, False, False, True, False, True, True, False, False, True,
    ]  # fmt: skip


def test_joints_of_two_publishers_keep_their_own_periods() -> None:
    frames = JointFrames(JOINTS, PERIOD)
    assert frames.due(1000, ["turn"])
    assert frames.due(990, ["push"])
    assert not frames.due(1050, ["turn"])
    assert not frames.due(1040, ["push"])


def test_a_moving_joints_pose_is_its_origin_then_its_motion() -> None:
    frames = JointFrames(JOINTS, PERIOD)
    assert frames.pose("push", 0.5).position == (1.0, 0.5, 0.0)
    assert frames.pose("turn", 1.0).yaw == pytest.approx(1.0)


def serialised(message: JointState) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def test_a_joint_state_is_read_as_it_was_written() -> None:
    message = JointState(
        name=["a", "größer", ""], position=[1.5, -2.0, 0.0], velocity=[3.0], effort=[]
    )
    message.header.frame_id = "frame"
    message.header.stamp.secs, message.header.stamp.nsecs = 12, 34
    assert joint_positions(memoryview(serialised(message))) == (
        12_000_000_034,
        ("a", "größer", ""),
        (1.5, -2.0, 0.0),
    )


@pytest.mark.parametrize("seed", range(20))
def test_bytes_that_are_no_joint_state_are_an_error_of_their_own(seed: int) -> None:
    chance = random.Random(seed)
    whole = serialised(JointState(name=["a", "b"], position=[1.0, 2.0]))
    for _ in range(200):
        broken = bytearray(whole[: chance.randrange(len(whole) + 1)])
        for _ in range(chance.randrange(3)):
            if broken:
                broken[chance.randrange(len(broken))] = chance.randrange(256)
        try:
            state = joint_positions(bytes(broken))
        except MalformedMessageError:
            continue
        assert len(state.names) == len(state.positions)


def test_other_numbers_of_names_and_positions_are_refused() -> None:
    with pytest.raises(MalformedMessageError, match="2 joints and 1 positions"):
        joint_positions(serialised(JointState(name=["a", "b"], position=[1.0])))
    with pytest.raises(MalformedMessageError, match="no JointState"):
        joint_positions(struct.pack("<I", 7))
