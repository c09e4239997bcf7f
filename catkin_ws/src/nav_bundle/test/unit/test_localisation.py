"""A robot with noisy odometry and a noisy laser stays localised: closed-loop tests of the core without ROS."""

import dataclasses
import math

import numpy as np
import pytest
from drawn_room import ROOM, enlarged, ranges_at

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.scan import Scan
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.localisation import Localisation, NoMapError

CONFIG = AmclConfig(
    min_particles=500, max_particles=2000, kld_err=0.05, laser_max_beams=60, laser_max_range=12.0, laser_z_hit=0.5,
    laser_z_rand=0.5, update_min_d=0.25, update_min_a=0.2, resample_interval=1, odom_alpha5=0.1,
    recovery_alpha_slow=0.0, recovery_alpha_fast=0.0,
)  # fmt: skip
COVARIANCE = np.diag([0.25, 0.25, 0.07])
LASER = Pose(0.1, 0.0, 0.0)


class FakeRobot:
    """Drives round the room. Its odometry overestimates distances by 3 %, and its laser has 1 cm of noise."""

    def __init__(self, seed: int) -> None:
        self.grid = enlarged(ROOM)
        self.generator = np.random.default_rng(seed)
        self.pose, self.odom = Pose(1.5, 1.0, 0.0), Pose(20.0, -7.0, 2.0)

    def drive(self, length: float, turn: float) -> None:
        self.pose = self.pose.compose(Pose(length, 0.0, turn))
        turn += self.generator.normal(0, 0.02 * abs(turn) + 0.01 * length)
        self.odom = self.odom.compose(
            Pose(1.03 * length + self.generator.normal(0, 0.02 * length), 0.0, turn)
        )

    def scan(self) -> Scan:
        noisy = ranges_at(self.grid, self.pose, LASER) + self.generator.normal(0, 0.01, 180)
        return Scan(noisy.astype(np.float32), -math.pi, math.tau / 179, 0.1, 30.0, LASER)


def errors_along(robot: FakeRobot, localisation: Localisation, laps: int = 2) -> np.ndarray:
    """Drives laps round the room and returns the error [m] of map_from_odom ∘ odom at every step of 5 cm."""
    errors, map_from_odom = [], None
    for _ in range(laps):
        for length in (6.3, 3.8, 6.3, 3.8):
            steps = [(0.05, 0.0)] * round(length / 0.05) + [(0.0, math.pi / 20)] * 10
            for step in steps:
                if localisation.due(robot.odom):
                    update = localisation.advance(robot.odom, robot.scan())
                    map_from_odom = update.map_from_odom or map_from_odom
                assert map_from_odom is not None
                errors.append(map_from_odom.compose(robot.odom).distance(robot.pose))
                robot.drive(*step)
    return np.array(errors)


def localised(config: AmclConfig, seed: int) -> tuple[FakeRobot, Localisation]:
    robot, localisation = FakeRobot(seed), Localisation(config, np.random.default_rng(seed))
    localisation.set_map(robot.grid)
    offset = robot.pose.compose(Pose(0.2, -0.2, 0.1))
    localisation.set_pose(offset, COVARIANCE)
    return robot, localisation


@pytest.mark.parametrize("seed", range(3))
def test_a_driving_robot_is_tracked_to_two_centimetres(seed: int) -> None:
    errors = errors_along(*localised(CONFIG, seed))
    assert errors.mean() < 0.02
    assert errors.max() < 0.05


@pytest.mark.parametrize("seed", range(2))
def test_the_particles_alone_stay_within_a_decimetre(seed: int) -> None:
    errors = errors_along(*localised(dataclasses.replace(CONFIG, refine_estimate=False), seed))[60:]
    assert errors.mean() < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_odometry_that_overrates_turns_by_a_tenth_does_not_turn_the_estimate(seed: int) -> None:
    robot, localisation = localised(CONFIG, seed)
    update, errors = None, []
    for step in range(400):
        if localisation.due(robot.odom):
            update = localisation.advance(robot.odom, robot.scan()).estimate or update
            assert update is not None
            errors.append(abs(angle_difference(update.pose.yaw, robot.pose.yaw)))
        robot.drive(0.0, 0.1 if step < 200 else -0.1)
        robot.odom = robot.odom.compose(Pose(0.0, 0.0, 0.01 if step < 200 else -0.01))
    assert np.mean(errors) < 0.005


def test_things_the_map_does_not_know_mislead_nobody() -> None:
    robot, localisation = localised(CONFIG, 11)
    in_the_way = robot.scan

    def scan_past_people() -> Scan:
        scan = in_the_way()
        scan.ranges[40:75] = np.minimum(scan.ranges[40:75], 0.7)  # a fifth of the field of view
        return scan

    robot.scan = scan_past_people  # type: ignore[method-assign]
    assert errors_along(robot, localisation).mean() < 0.03


@pytest.mark.parametrize("model", ["beam", "likelihood_field_prob"])
def test_every_laser_model_tracks_the_robot(model: str) -> None:
    config = dataclasses.replace(
        CONFIG, laser_model_type=model, do_beamskip=True, odom_model_type="diff-corrected"
    )
    assert errors_along(*localised(config, 4), laps=1)[60:].mean() < 0.08


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_a_robot_put_elsewhere_is_found_again(seed: int) -> None:
    config = dataclasses.replace(
        CONFIG, recovery_alpha_slow=0.001, recovery_alpha_fast=0.1, max_particles=4000
    )
    robot, localisation = localised(config, seed)
    errors_along(robot, localisation, laps=1)
    robot.pose = Pose(4.2, 4.3, 1.0)
    for _ in range(400):
        robot.drive(0.0, 0.1)
        if localisation.due(robot.odom):
            update = localisation.advance(robot.odom, robot.scan())
    assert update.estimate is not None
    assert update.estimate.pose.distance(robot.pose) < 0.05


def test_a_robot_that_may_be_anywhere_is_found() -> None:
    config = dataclasses.replace(CONFIG, max_particles=8000, laser_model_type="likelihood_field")
    robot, localisation = localised(config, 3)
    localisation.scatter()
    assert errors_along(robot, localisation, laps=2)[-100:].mean() < 0.1


def test_equal_seeds_give_equal_results() -> None:
    first, second = (errors_along(*localised(CONFIG, 5), laps=1) for _ in range(2))
    assert (first == second).all()


def test_a_robot_at_rest_is_not_updated_unless_asked() -> None:
    robot, localisation = localised(CONFIG, 1)
    assert localisation.due(robot.odom)
    localisation.advance(robot.odom, robot.scan())
    assert not localisation.due(robot.odom)
    assert not localisation.due(robot.odom.compose(Pose(0.1, 0.1, 0.1)))
    assert localisation.due(robot.odom.compose(Pose(0.0, 0.0, -0.3)))
    localisation.force_update()
    assert localisation.due(robot.odom)
    localisation.advance(robot.odom, robot.scan())
    assert not localisation.due(robot.odom)


def test_the_estimate_comes_with_each_resampling() -> None:
    robot, localisation = localised(dataclasses.replace(CONFIG, resample_interval=2), 1)
    given = []
    for _ in range(5):
        localisation.force_update()
        given.append(localisation.advance(robot.odom, robot.scan()).estimate is not None)
    assert given == [True, True, False, True, False]


def test_nothing_works_without_a_map() -> None:
    localisation = Localisation(CONFIG, np.random.default_rng(0))
    assert not localisation.has_map
    with pytest.raises(NoMapError, match="no map yet"):
        localisation.scatter()
    with pytest.raises(NoMapError, match="no map yet"):
        localisation.advance(Pose(), FakeRobot(0).scan())


def test_a_scan_of_nothing_changes_no_weight() -> None:
    robot, localisation = localised(CONFIG, 1)
    for ranges in (np.full(180, np.inf), np.full(180, np.nan), np.zeros(180), np.zeros(0)):
        localisation.force_update()
        scan = Scan(ranges.astype(np.float32), -3.14, 0.035, 0.1, 30.0, LASER)
        assert localisation.advance(robot.odom, scan).estimate is not None


def test_a_laser_mounted_upside_down_is_read_the_other_way_round() -> None:
    robot = FakeRobot(2)
    scan = robot.scan()
    flipped = dataclasses.replace(
        scan, ranges=scan.ranges[::-1], angle_min=math.pi, angle_increment=-scan.angle_increment
    )
    points = scan.thinned(180, 0, 0).end_points()
    assert np.allclose(
        np.sort(points, axis=0), np.sort(flipped.thinned(180, 0, 0).end_points(), axis=0), atol=1e-5
    )


def half_scan(robot: FakeRobot, mount: Pose) -> Scan:
    """Returns the scan of a laser at ``mount`` that sees half a circle ahead of itself."""
    ranges = ranges_at(robot.grid, robot.pose, mount)[45:135]
    first = -math.pi + 45 * math.tau / 179
    return Scan(ranges.astype(np.float32), first, math.tau / 179, 0.1, 30.0, mount)


def test_of_several_lasers_each_is_used_once_after_a_movement() -> None:
    """Both send a scan at each step; the rear one's used to be dropped for ever."""
    robot, localisation = localised(CONFIG, 3)
    mounts = {"front": Pose(0.2, 0.0, 0.0), "rear": Pose(-0.2, 0.0, math.pi)}
    used, errors, map_from_odom = [], [], None
    for _ in range(60):
        for name, mount in mounts.items():
            if localisation.due(robot.odom, name):
                used.append(name)
                update = localisation.advance(robot.odom, half_scan(robot, mount), name)
                map_from_odom = update.map_from_odom or map_from_odom
        assert map_from_odom is not None
        errors.append(map_from_odom.compose(robot.odom).distance(robot.pose))
        robot.drive(0.05, 0.0)
    assert used == ["front", "rear"] * (len(used) // 2)
    assert 20 <= len(used) <= 30
    assert np.mean(errors[10:]) < 0.05


def test_a_forced_update_uses_each_laser_once() -> None:
    robot, localisation = localised(CONFIG, 3)
    for name in ("front", "rear"):
        localisation.advance(robot.odom, robot.scan(), name)
        assert not localisation.due(robot.odom, name)
    localisation.force_update()
    assert localisation.due(robot.odom, "rear")
    localisation.advance(robot.odom, robot.scan(), "rear")
    assert [localisation.due(robot.odom, name) for name in ("rear", "front")] == [False, True]
