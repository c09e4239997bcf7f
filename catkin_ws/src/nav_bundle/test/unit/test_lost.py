"""Global localisation, and recovery of a kidnapped robot: seeded trials in a building.

The building is that of the golden scenarios: 167 m² of free space in six rooms. The robot wanders about its hall.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import drawn_room
import numpy as np
from drawn_room import ranges_at
from wanderer import Wanderer

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.scan import Scan
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.localisation import Localisation
from nav_bundle.localisation.sensor_model import DistanceField
from nav_bundle.maps.grid import FREE
from nav_bundle.maps.map_file import read_map

BUILDING = read_map(Path(drawn_room.__file__).with_name("scenario.yaml"))
CLEARANCE = DistanceField(BUILDING, 1.0)
# The Pioneer's parameters.
CONFIG = AmclConfig(
    min_particles=500, max_particles=2000, kld_err=0.05, laser_max_beams=60, laser_max_range=12.0, laser_z_hit=0.5,
    laser_z_rand=0.5, update_min_d=0.25, update_min_a=0.2, resample_interval=1,
    recovery_alpha_slow=0.0, recovery_alpha_fast=0.0,
)  # fmt: skip
RECOVERING = replace(CONFIG, recovery_alpha_slow=0.001, recovery_alpha_fast=0.1)
LASER = Pose(0.08, 0.0, 0.0)
BEARINGS = np.linspace(-math.pi, math.pi, 180)
PERIOD = 0.2
"""[s] between scans."""
SURE = 5.0
"""A robot whose estimate is right for this long [s] is localised."""
TRIALS = 25


class Trial:
    """One robot in the hall."""

    def __init__(self, config: AmclConfig, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        self.localisation = Localisation(config, self.generator)
        self.localisation.set_map(BUILDING)
        self.pose, self.odom, self.belief = self.somewhere(), Pose(3.0, -7.0, 1.0), Pose()
        self.wanderer = Wanderer()

    def somewhere(self) -> Pose:
        """Returns a random pose in the hall with a clearance of 0.4 m."""
        while True:
            x, y, yaw = self.generator.uniform([0.4, 0.4, -math.pi], [9.6, 6.6, math.pi])
            cell = BUILDING.cell_at(x, y)
            if (
                BUILDING.cells[cell] == FREE
                and CLEARANCE.cells.squares[cell] > (0.4 / BUILDING.resolution) ** 2
            ):
                return Pose(x, y, yaw)

    def right(self) -> bool:
        error = self.belief.compose(self.odom)
        return (
            error.distance(self.pose) < 0.3
            and abs(angle_difference(error.yaw, self.pose.yaw)) < 0.3
        )

    def wander(self, seconds: float) -> Iterator[bool]:
        """Yields for each scan whether the robot's pose estimate is right."""
        for _ in range(round(seconds / PERIOD)):
            ranges = ranges_at(BUILDING, self.pose, LASER) + self.generator.normal(0.0, 0.01, 180)
            if self.localisation.due(self.odom):
                scan = Scan(ranges.astype(np.float32), -math.pi, math.tau / 179, 0.1, 30.0, LASER)
                self.belief = (
                    self.localisation.advance(self.odom, scan).map_from_odom or self.belief
                )
            yield self.right()
            speed, turn = self.wanderer.command(ranges, BEARINGS)
            step = Pose(speed * PERIOD, 0.0, turn * PERIOD)
            self.pose, self.odom = self.pose.compose(step), self.odom.compose(step)

    def time_to_find(self, limit: float) -> float:
        """Returns when the pose estimate became right for good [s]; infinity if not within ``limit``."""
        since = math.inf
        for index, right in enumerate(self.wander(limit + SURE)):
            since = min(since, index * PERIOD) if right else math.inf
            if index * PERIOD - since > SURE:
                break
        return since


def lost(config: AmclConfig, seed: int) -> float:
    trial = Trial(config, seed)
    trial.localisation.scatter()
    return trial.time_to_find(60.0)


def kidnapped(config: AmclConfig, seed: int) -> float:
    trial = Trial(config, seed)
    trial.localisation.set_pose(trial.pose, np.eye(3) * 0.01)
    assert all(trial.wander(2.0))
    before = trial.pose
    while trial.pose.distance(before) < 2.0:
        trial.pose = trial.somewhere()
    return trial.time_to_find(60.0)


def test_every_robot_that_may_be_anywhere_finds_itself_within_a_minute() -> None:
    times = [lost(CONFIG, seed) for seed in range(TRIALS)]
    assert max(times) <= 60.0, times
    assert np.median(times) < 12.0


def test_every_robot_carried_off_finds_itself_within_a_minute_where_recovery_is_on() -> None:
    times = [kidnapped(RECOVERING, seed) for seed in range(TRIALS)]
    assert max(times) <= 60.0, times
    assert np.median(times) < 25.0


def test_a_robot_that_is_lost_reports_it_and_one_that_is_not_does_not() -> None:
    trial = Trial(CONFIG, 3)
    trial.localisation.set_pose(trial.pose, np.eye(3) * 0.01)
    assert not any(trial.localisation.lost for _ in trial.wander(20.0))
    trial.pose = trial.pose.compose(Pose(0.0, 0.0, 2.5))
    assert any(trial.localisation.lost for _ in trial.wander(20.0))
    trial.localisation.set_pose(trial.pose, np.eye(3) * 0.01)
    assert not trial.localisation.lost


def test_without_recovery_a_robot_carried_off_stays_lost() -> None:
    assert kidnapped(CONFIG, 0) == math.inf
