"""The track that is computed from one robot's messages."""

import math

import numpy as np
import pytest

from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.scenario.waypoint import Leg
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.client import ClientState, Queue


def leg(x, y=0.0):
    return Leg(Pose(x, y), np.array([[0.0, 0.0], [x, y]]), math.hypot(x, y))


def queue(reached=0, aborted=0, state=ClientState.DRIVING):
    return Queue(state, 2, reached, aborted, "")


@pytest.fixture
def track():
    track = RobotTrack("pioneer1")
    track.assign([leg(1.0), leg(2.0)])
    return track


def test_the_localisation_error_is_taken_at_the_stamp_of_the_true_pose(track):
    track.add_correction(Pose(10.0, 0.0))
    track.add_odometry(0.0, Pose(0.0, 0.0))
    track.add_truth(0.1, Pose(10.1, 0.3))
    assert not track.errors
    track.add_odometry(0.2, Pose(0.2, 0.0))
    assert track.errors == pytest.approx([0.3])


def test_errors_are_taken_ten_times_a_second_at_most(track):
    track.add_correction(Pose(0.0, 0.0))
    for tick in range(101):
        track.add_odometry(tick * 0.01, Pose(0.0, 0.0))
        track.add_truth(tick * 0.01, Pose(0.0, 0.05))
    assert 9 <= len(track.errors) <= 11
    assert track.error_statistics() == pytest.approx((0.05, 0.05, 0.05))


def test_no_error_is_counted_before_the_robot_is_localised(track):
    track.add_odometry(0.0, Pose(0.0, 0.0))
    track.add_truth(0.0, Pose(5.0, 5.0))
    assert math.isnan(track.error)


def test_path_and_first_motion_ignore_trembling(track):
    for tick in range(100):
        track.add_truth(tick * 0.1, Pose(0.01 * (tick % 2), 0.0))
    assert track.path_length == 0.0
    assert track.first_motion is None
    track.add_truth(10.0, Pose(0.5, 0.0))
    assert track.first_motion == 10.0
    assert track.path_length == pytest.approx(0.5)


def test_a_reached_waypoint_is_noted_with_its_true_distance(track):
    track.add_truth(7.0, Pose(0.8, 0.0))
    track.add_queue(queue(reached=1))
    first, second = track.visits
    assert (first.reached, first.time, second.reached) == (True, 7.0, None)
    assert first.distance == pytest.approx(0.2)
    assert not track.finished


def test_an_aborted_waypoint_ends_the_robots_work_too_but_is_not_reached(track):
    track.add_queue(queue(aborted=1))
    track.add_queue(queue(aborted=1, reached=1))
    assert track.finished
    assert track.reached == 1


def test_a_report_that_was_missed_is_made_up_for_by_the_next(track):
    track.add_queue(queue(reached=2))
    assert track.finished


def test_the_distance_to_go_follows_the_plan_to_the_current_waypoint(track):
    track.add_truth(0.0, Pose(0.0, 0.0))
    assert track.distance_to_go == pytest.approx(1.0)
    track.add_plan([(0.0, 0.0), (0.0, 2.0), (1.0, 2.0), (1.0, 0.0)])
    assert track.distance_to_go == pytest.approx(5.0)


def test_only_the_first_plan_to_a_waypoint_is_kept_as_its_planned_way(track):
    first, second = [(0.0, 0.0), (1.0, 0.0)], [(0.5, 0.0), (1.0, 0.0)]
    track.add_plan(first)
    track.add_plan(second)
    assert track.visits[0].planned == first
    assert not track.visits[1].planned


def test_a_plan_to_another_goal_is_not_the_planned_way(track):
    track.add_plan([(0.0, 0.0), (9.0, 9.0)])
    assert not track.visits[0].planned


def test_a_robot_that_a_fault_moves_has_not_driven_the_way(track):
    for tick in range(11):
        track.add_truth(0.1 * tick, Pose(0.1 * tick, 0.0))
    track.move((10.0, 5.0))
    track.add_truth(1.1, Pose(1.1, 0.0))  # sent before the simulator moved it
    for tick in range(11):
        track.add_truth(1.2 + 0.1 * tick, Pose(10.0 + 0.1 * tick, 5.0))
    assert track.path_length == pytest.approx(2.1)
    assert track.driven[-1] == (11.0, 5.0)


def test_a_reset_of_the_simulation_does_not_freeze_the_record(track):
    track.add_correction(Pose(0.0, 0.0))
    for start in (100.0, 0.0):
        for tick in range(20):
            track.add_odometry(start + 0.1 * tick, Pose(0.1 * tick, 0.0))
            track.add_truth(start + 0.1 * tick, Pose(0.1 * tick, 0.02 if start else 0.05))
    assert track.error == pytest.approx(0.05)
    assert track.pose == Pose(pytest.approx(1.9), 0.05)
    track.add_truth(1.6, Pose(9.0, 9.0))  # a message that came late
    assert track.pose.x == pytest.approx(1.9)


@pytest.mark.parametrize("count", [2**32 - 1, 3])
def test_a_report_of_any_number_of_waypoints_closes_those_that_there_are(track, count):
    track.add_queue(queue(reached=count))
    assert track.finished
    assert track.reached == 2
    track.add_queue(queue(reached=0, aborted=count))
    assert track.reached == 2
