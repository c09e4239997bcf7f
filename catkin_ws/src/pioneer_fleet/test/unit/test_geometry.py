"""Planar poses: composition, interpolation and measurement."""

import math

import pytest

from pioneer_fleet.geometry import Pose, length, remaining_length, yaw_from_quaternion


def test_a_pose_composes_with_what_lies_ahead_of_it():
    ahead = Pose(1.0, 2.0, math.pi / 2).compose(Pose(3.0, 0.0, math.pi / 2))
    assert (ahead.x, ahead.y) == pytest.approx((1.0, 5.0))
    assert abs(ahead.yaw) == pytest.approx(math.pi)


def test_halfway_between_headings_goes_the_short_way_round():
    assert abs(Pose(0, 0, 3.0).between(Pose(0, 0, -3.0), 0.5).yaw) == pytest.approx(math.pi)


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 0.5, 3.1])
def test_the_heading_of_a_quaternion_is_its_turn_about_z(yaw):
    assert yaw_from_quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)) == pytest.approx(yaw)


def test_the_length_of_a_line_is_the_sum_of_its_parts():
    assert length([(0, 0), (3, 4), (3, 5)]) == pytest.approx(6.0)
    assert length([]) == 0.0


def test_what_remains_of_a_line_counts_from_the_nearest_point():
    assert remaining_length([(0, 0), (1, 0), (2, 0), (3, 0)], (2.0, 0.5)) == pytest.approx(1.5)
    assert remaining_length([], (0.0, 0.0)) == 0.0
