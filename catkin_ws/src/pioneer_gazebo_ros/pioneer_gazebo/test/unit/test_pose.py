import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pioneer_gazebo.world.pose import IDENTITY, Pose

angle = st.floats(-3.1, 3.1)
length = st.floats(-50.0, 50.0)
poses = st.builds(Pose.from_rpy, length, length, length, angle, angle, angle)


def test_rpy_turns_about_fixed_axes_x_first():
    pose = Pose.from_rpy(roll=math.pi / 2, yaw=math.pi / 2)
    assert pose.transform((0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0))
    assert pose.transform((0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0))


@given(angle, st.floats(-1.5, 1.5), angle)
def test_rpy_comes_back(roll, pitch, yaw):
    assert Pose.from_rpy(0, 0, 0, roll, pitch, yaw).rpy() == pytest.approx(
        (roll, pitch, yaw), abs=1e-6
    )


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_at_the_pole_is_the_same_rotation(pitch):
    pose = Pose.from_rpy(0, 0, 0, 0.3, pitch, 0.8)
    again = Pose.from_rpy(0, 0, 0, *pose.rpy())
    np.testing.assert_allclose(again.matrix(), pose.matrix(), atol=1e-6)


@given(poses, poses)
def test_compose_is_the_matrix_product(a, b):
    np.testing.assert_allclose(a.compose(b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)


@given(poses)
def test_inverse_undoes(pose):
    np.testing.assert_allclose(pose.compose(pose.inverse()).matrix(), np.eye(4), atol=1e-9)


@given(poses)
def test_matrix_comes_back(pose):
    np.testing.assert_allclose(Pose.from_matrix(pose.matrix()).matrix(), pose.matrix(), atol=1e-9)


def test_quaternion_is_brought_to_length_1():
    assert Pose.from_quaternion((0, 0, 0), (0, 0, 0, 2)) == IDENTITY


def test_quaternion_of_length_0_is_refused():
    with pytest.raises(ValueError, match="length 1"):
        Pose.from_quaternion((0, 0, 0), (0, 0, 0, 0))
