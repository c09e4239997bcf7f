"""From commands to wheel speeds and from wheel angles to odometry."""

import dataclasses
import itertools
import math

import pytest

from pioneer_gazebo.simulation.drive import CommandError, Drive, Odometry
from pioneer_gazebo.simulation.entity import CollisionCounter
from pioneer_gazebo.world.robot import DiffDrive

STEP = 0.02
CONFIG = DiffDrive(wheelSeparation=0.33, wheelDiameter=0.195, wheelAcceleration=3.0)


def follow(drive: Drive, steps: int, slip: float = 1.0) -> tuple[float, float]:
    """Turns ideal wheels at the commanded speeds; returns their angles."""
    left = right = 0.0
    speeds = (0.0, 0.0)
    drive.measure(left, right, STEP)
    for _ in range(steps):
        speeds = drive.wheel_speeds(STEP) or speeds
        left += speeds[0] * STEP * slip
        right += speeds[1] * STEP * slip
        drive.measure(left, right, STEP)
    return left, right


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_refused_and_the_one_before_holds(value: float) -> None:
    drive = Drive(CONFIG)
    drive.command(0.5, 0.0)
    for command in ((value, 0.0), (0.0, value)):
        with pytest.raises(CommandError, match="must be finite"):
            drive.command(*command)
    follow(drive, 100)
    assert drive.odometry.speed == pytest.approx(0.5)


def test_without_a_command_for_the_timeout_the_wheels_stop_until_the_next() -> None:
    drive = Drive(dataclasses.replace(CONFIG, commandTimeout=0.6))

    def rim_after(seconds: float) -> float:
        """Returns the rim speed last sent within ``seconds`` without a command; NaN if none was sent."""
        sent = [drive.wheel_speeds(STEP) for _ in range(round(seconds / STEP))]
        told = [speeds for speeds in sent if speeds is not None]
        return told[-1][0] * 0.0975 if told else math.nan

    for _ in range(2):
        drive.command(0.5, 0.0)
        assert rim_after(0.5) == pytest.approx(0.5)
        drive.command(0.5, 0.0)
        assert math.isnan(rim_after(0.56))  # nothing new to send: the wheels keep turning
        assert rim_after(0.5) == pytest.approx(0.0)


def test_speed_ramps_no_faster_than_the_wheels_acceleration() -> None:
    drive = Drive(CONFIG)
    drive.command(1.2, 0.0)
    speeds = [drive.wheel_speeds(STEP) for _ in range(30)]
    rims = [0.0, *(speed[0] * 0.0975 for speed in speeds if speed is not None)]
    rises = [b - a for a, b in itertools.pairwise(rims)]
    assert max(rises) <= 3.0 * STEP + 1e-12
    assert rims[-1] == pytest.approx(1.2)


def test_an_arc_is_the_same_arc_while_the_robot_gains_speed() -> None:
    drive = Drive(CONFIG)
    drive.command(1.0, 1.0)
    while (speeds := drive.wheel_speeds(STEP)) is not None:
        left, right = speeds
        assert (right - left) * 0.0975 / 0.33 == pytest.approx((right + left) / 2 * 0.0975)


def test_odometry_of_a_straight_run_is_the_way_of_the_wheels() -> None:
    drive = Drive(CONFIG)
    drive.command(0.5, 0.0)
    left, right = follow(drive, 200)
    assert drive.odometry.x == pytest.approx((left + right) / 2 * 0.0975)
    assert drive.odometry.y == 0.0


def test_odometry_of_a_full_circle_returns_to_its_start() -> None:
    drive = Drive(CONFIG)
    drive.command(0.5, 1.0)
    follow(drive, 1)
    drive.command(0.5, 1.0)
    before = drive.odometry
    follow(drive, round(math.tau / STEP))
    assert math.hypot(drive.odometry.x - before.x, drive.odometry.y - before.y) < 0.08


def test_an_encoder_that_believes_in_larger_wheels_sees_a_longer_way() -> None:
    true, wrong = Drive(CONFIG), Drive(CONFIG, 1.03, 1.03)
    for drive in (true, wrong):
        drive.command(0.5, 0.0)
        follow(drive, 100)
    assert wrong.odometry.x == pytest.approx(1.03 * true.odometry.x)


def test_a_wheel_that_was_held_up_does_not_race_to_catch_up() -> None:
    drive = Drive(CONFIG)
    drive.command(0.5, 0.0)
    follow(drive, 200, slip=0.0)
    speeds = drive.wheel_speeds(STEP)
    wanted = 0.5 / 0.0975
    assert (speeds or (wanted,))[0] < wanted + 0.3


def test_reset_stops_the_wheels_and_puts_odometry_to_the_origin() -> None:
    drive = Drive(CONFIG)
    drive.command(0.5, 0.2)
    follow(drive, 50)
    drive.reset()
    assert drive.at_rest
    assert drive.odometry == Odometry()
    assert drive.wheel_speeds(STEP) is None


def test_odometry_between_two_steps_turns_the_short_way() -> None:
    half = Odometry(0, 0, 3.1).towards(Odometry(1, 0, -3.1), 0.5)
    assert abs(math.remainder(half.yaw - math.pi, math.tau)) < 1e-9
    assert half.x == 0.5


def test_contacts_without_a_pause_are_one_collision() -> None:
    counter = CollisionCounter()
    began = [counter.touched(time) for time in (1.0, 1.2, 1.6, 2.0, 2.5, 2.9)]
    assert began == [True, False, False, False, True, False]
    assert counter.count == 2
