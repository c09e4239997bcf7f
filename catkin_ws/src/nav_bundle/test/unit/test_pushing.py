"""A robot that pushes against something is detected, a driving one is not; it backs up before any other recovery."""

import math

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Picture
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.move_base.pushing import PushingWatch, stayed
from nav_bundle.move_base.recovery import BackUp, ClearConfig, ClearCostmapRecovery, Surroundings

FORWARD = Velocity(0.3)


def picture(true, odom, width=8.0, height=5.0):
    """Returns what the laser sees at ``true`` in a room around the origin, placed by the odometry pose ``odom``."""
    bearings = np.linspace(-math.pi, math.pi, 180, endpoint=False)
    x, y = np.cos(bearings + true.yaw), np.sin(bearings + true.yaw)
    to_x = (np.sign(x) * width / 2 - true.x) / np.where(x == 0.0, 1e-9, x)
    to_y = (np.sign(y) * height / 2 - true.y) / np.where(y == 0.0, 1e-9, y)
    ranges = np.minimum(to_x, to_y) + np.random.default_rng(1).normal(0.0, 0.01, 180)
    seen = ranges < 20.0
    angles = bearings[seen] + odom.yaw
    points = np.stack(
        [odom.x + ranges[seen] * np.cos(angles), odom.y + ranges[seen] * np.sin(angles)], axis=1
    )
    return Picture(odom, points)


@pytest.mark.parametrize("step", [Pose(0.2), Pose(0.15, 0.0, 0.1), Pose(0.0, 0.0, 0.35)])
def test_the_laser_tells_driving_from_slipping(step):
    start = Pose(0.5, -0.3, 0.4)
    before = picture(start, Pose(3.0, 2.0, 1.0))
    odom = Pose(3.0, 2.0, 1.0).compose(step)
    assert stayed(before, picture(start.compose(step), odom)) is False
    assert stayed(before, picture(start, odom)) is True


def test_in_a_corridor_without_an_end_in_sight_nothing_is_reported():
    before, step = picture(Pose(), Pose(), width=200.0, height=2.0), Pose(0.2)
    assert stayed(before, picture(step, step, width=200.0, height=2.0)) is None


def test_slipping_wheels_are_noticed_within_half_a_metre():
    watch, odom = PushingWatch(3.0), Pose()
    for _ in range(5):
        watch.note_motion(FORWARD, FORWARD, Pose(), 0.0)
        watch.note_picture(picture(Pose(), odom))
        odom = odom.compose(Pose(0.1))
    assert watch.pushes(0.0)
    watch.reset()
    assert not watch.pushes(0.0)


@pytest.mark.parametrize(
    ("command", "measured", "noticed"),
    [
        (FORWARD, STANDSTILL, True),
        (FORWARD, FORWARD, False),
        (STANDSTILL, STANDSTILL, False),
        (None, STANDSTILL, False),
    ],
)
def test_a_robot_that_stands_against_a_command_is_noticed_in_time(command, measured, noticed):
    watch = PushingWatch(3.0)
    for now in np.arange(0.0, 3.2, 0.05):
        watch.note_motion(command, measured, Pose(), float(now))
    assert watch.pushes(2.9) is False
    assert watch.pushes(3.1) == noticed
    switched_off = PushingWatch(0.0)
    switched_off.note_motion(command, measured, Pose(), 0.0)
    assert not switched_off.pushes(100.0)


def test_it_backs_off_by_a_third_of_a_metre_and_then_recovers():
    costmap = Costmap(
        costmap_config_from_parameters(
            {"width": 6.0, "height": 6.0, "rolling_window": True}, "test"
        )
    )
    costmap.update(Pose(), [])
    recovery = BackUp(ClearCostmapRecovery("reset", ClearConfig()))
    recovery.start()
    x = 0.0
    while velocity := recovery.step(Surroundings(costmap, Pose(x), costmap, Pose(x), 0.0)):
        assert velocity.x < 0.0
        x += velocity.x * 0.05
    assert x == pytest.approx(-0.3, abs=0.02)


def test_odometry_without_a_velocity_is_no_sign_of_a_robot_that_stands():
    watch = PushingWatch(1.0)
    for step in range(100):
        watch.note_motion(FORWARD, Velocity(), Pose(0.02 * step), 0.05 * step)
        assert not watch.pushes(0.05 * step)
    for step in range(100, 130):
        watch.note_motion(FORWARD, Velocity(), Pose(2.0), 0.05 * step)
    assert watch.pushes(0.05 * 130)
