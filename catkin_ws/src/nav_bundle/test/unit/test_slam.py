"""A robot with a noisy laser and bad odometry builds its map: closed-loop tests of the core without ROS."""

import dataclasses
import math
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from drawn_room import ROOM, enlarged, ranges_at

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.scan import Scan
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.mapping.slam import Slam
from nav_bundle.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from nav_bundle.maps.map_quality import agreement
from pioneer_node.core.parameter import ParameterError

CORRIDORS = [
    "######################",
    "#....................#",
    "#....................#",
    "#..################..#",
    "#..################..#",
    "#..################..#",
    "#..################..#",
    "#..################..#",
    "#....................#",
    "#....................#",
    "######################",
]
CONFIG = GmappingConfig(xmin=-15.0, ymin=-15.0, xmax=15.0, ymax=15.0)
LASER = Pose(0.1, 0.0, 0.2)


class FakeRobot:
    """A robot whose odometry overestimates distances by 3 % and has noisy turns; its laser has 1 cm of noise."""

    def __init__(self, grid: Grid, start: Pose, seed: int, bad: float = 1.0) -> None:
        self.grid, self.bad = grid, bad
        self.generator = np.random.default_rng(seed)
        self.start, self.pose, self.odom = start, start, Pose(2.0, -1.0, 0.7)
        self.map_from_world = self.odom.compose(start.inverse())

    def drive(self, length: float, turn: float) -> None:
        self.pose = self.pose.compose(Pose(length, 0.0, turn))
        turn += self.bad * self.generator.normal(0, 0.05 * abs(turn) + 0.02 * length)
        length *= 1.0 + self.bad * (0.03 + self.generator.normal(0, 0.05))
        self.odom = self.odom.compose(Pose(length, 0.0, turn))

    def scan(self, beams: int = 180) -> Scan:
        ranges = ranges_at(self.grid, self.pose, LASER, beams, 12.0)
        noisy = np.where(ranges < 12.0, ranges + self.generator.normal(0, 0.01, beams), np.inf)
        return Scan(noisy.astype(np.float32), -math.pi, math.tau / (beams - 1), 0.1, 12.0, LASER)


def laps(sides: tuple[float, ...], count: int) -> list[tuple[float, float]]:
    """Returns steps of 5 cm along the sides, with a left turn after each side."""
    return [
        step
        for _ in range(count)
        for side in sides
        for step in [(0.05, 0.0)] * round(side / 0.05) + [(0.0, math.pi / 20)] * 10
    ]


def errors_along(robot: FakeRobot, slam: Slam, steps: list[tuple[float, float]]) -> np.ndarray:
    """Returns the error (distance [m], heading [rad]) of map_from_odom ∘ odom at each scan used."""
    errors = []
    for number, step in enumerate([(0.0, 0.0), *steps]):
        robot.drive(*step)
        if slam.observe(robot.odom, robot.scan(), 0.1 * number):
            assert slam.map_from_odom is not None
            found = robot.map_from_world.inverse().compose(slam.map_from_odom.compose(robot.odom))
            errors.append(
                (found.distance(robot.pose), abs(angle_difference(found.yaw, robot.pose.yaw)))
            )
    return np.array(errors)


def in_room(seed: int, config: GmappingConfig = CONFIG, bad: float = 1.0) -> tuple[FakeRobot, Slam]:
    robot = FakeRobot(enlarged(ROOM), Pose(1.5, 1.0, 0.0), seed, bad)
    return robot, Slam(config, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(3))
def test_a_room_is_drawn_to_the_cell(seed: int) -> None:
    robot, slam = in_room(seed)
    errors = errors_along(robot, slam, laps((6.3, 3.8, 6.3, 3.8), 1))
    assert errors[:, 0].mean() < 0.03
    assert errors[:, 0].max() < 0.08
    assert errors[:, 1].max() < 0.03
    assert agreement(slam.grid(), robot.grid, robot.map_from_world.inverse()) > 0.95


def test_a_loop_of_corridors_closes() -> None:
    robot = FakeRobot(enlarged(CORRIDORS), Pose(0.8, 0.8, 0.0), 1)
    config = dataclasses.replace(CONFIG, linearUpdate=0.3, angularUpdate=0.25)
    slam = Slam(config, np.random.default_rng(1))
    errors = errors_along(robot, slam, laps((7.2, 2.8, 7.2, 2.8), 1))
    assert errors[:, 0].max() < 0.1
    assert errors[-1, 0] < 0.06
    assert errors[:, 1].max() < 0.03
    assert agreement(slam.grid(), robot.grid, robot.map_from_world.inverse()) > 0.9


def test_equal_seeds_give_equal_maps() -> None:
    results = []
    for _ in range(2):
        robot, slam = in_room(5)
        errors_along(robot, slam, laps((6.3, 3.8), 1))
        results.append((slam.poses.copy(), slam.grid().cells))
    assert (results[0][0] == results[1][0]).all()
    assert (results[0][1] == results[1][1]).all()


def test_other_seeds_give_other_particles() -> None:
    first, second = (in_room(5, seed_config) for seed_config in (CONFIG, CONFIG))
    second = (second[0], Slam(CONFIG, np.random.default_rng(6)))
    for robot, slam in (first, second):
        errors_along(robot, slam, laps((3.0,), 1))
    assert (first[1].poses != second[1].poses).any()


def test_uneven_weights_lead_to_a_resampling_that_shares_tiles() -> None:
    robot, slam = in_room(2, dataclasses.replace(CONFIG, ogain=0.05, resampleThreshold=0.9))
    errors = errors_along(robot, slam, laps((6.3, 3.8, 6.3, 3.8), 1))
    assert slam.resamplings > 0
    assert errors[:, 0].mean() < 0.05
    assert math.isclose(slam.weights().sum(), 1.0)
    assert 0.0 <= slam.entropy() <= math.log(30) + 1e-9


def test_the_map_frame_is_where_odometry_was_at_first() -> None:
    robot, slam = in_room(1)
    assert slam.map_from_odom is None
    assert slam.observe(robot.odom, robot.scan(), 0.0)
    assert slam.map_from_odom is not None
    assert slam.map_from_odom.distance(Pose()) < 1e-9


def test_scans_count_after_enough_of_path_turn_or_time() -> None:
    robot, slam = in_room(
        1, dataclasses.replace(CONFIG, linearUpdate=0.3, angularUpdate=0.4, temporalUpdate=2.0), 0.0
    )
    used = []
    moves = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.0), (0.11, 0.0), (0.0, 0.25), (0.0, -0.25), (0.0, 0.0)]
    for number, move in enumerate(moves):
        robot.drive(*move)
        used.append(slam.observe(robot.odom, robot.scan(), 0.1 * number))
    assert used == [
        True,
        False,
        False,
        True,
        False,
        True,
        False,
    ]  # opposite turns add up, as upstream
    assert not slam.observe(robot.odom, robot.scan(), 2.5)
    assert slam.observe(robot.odom, robot.scan(), 2.51)


def test_without_temporal_update_a_robot_at_rest_draws_nothing_new() -> None:
    robot, slam = in_room(1)
    assert slam.observe(robot.odom, robot.scan(), 0.0)
    assert not any(slam.observe(robot.odom, robot.scan(), 1e3 * number) for number in range(1, 4))


def test_beams_beyond_max_range_say_nothing_and_beyond_usable_range_clear() -> None:
    config = dataclasses.replace(CONFIG, maxUrange=2.0, maxRange=8.0)
    for reading, seen in (
        (9.0, {UNKNOWN}),
        (5.0, {UNKNOWN, FREE}),
        (1.0, {UNKNOWN, FREE, OCCUPIED}),
    ):
        slam = Slam(config, np.random.default_rng(0))
        slam.observe(
            Pose(), Scan(np.full(90, reading, np.float32), -1.0, 0.02, 0.1, 30.0, Pose()), 0.0
        )
        grid = slam.grid()
        assert set(np.unique(grid.cells).tolist()) == seen
        row, col = grid.cell_at(2.5, 0.0)
        assert grid.cells[row, col] == UNKNOWN


def test_readings_of_nothing_do_no_harm() -> None:
    robot, slam = in_room(1)
    slam.observe(robot.odom, robot.scan(), 0.0)
    for ranges in (np.full(180, np.inf), np.full(180, np.nan), np.zeros(180), np.zeros(0)):
        robot.drive(1.1, 0.0)
        scan = Scan(ranges.astype(np.float32), -3.14, 0.035, 0.1, 12.0, LASER)
        assert slam.observe(robot.odom, scan, 1.0)
    assert slam.unmatched == 30
    assert np.isfinite(slam.poses).all()


def test_the_map_grows_where_the_robot_leaves_its_extent() -> None:
    robot, slam = in_room(3, dataclasses.replace(CONFIG, xmin=0.0, ymin=-3.0, xmax=3.0, ymax=0.0))
    errors_along(robot, slam, laps((6.3, 3.8), 1))
    grid = slam.grid()
    assert grid.cols > 60
    assert grid.origin.x < 0.0
    assert math.isclose(math.remainder(grid.origin.x, 0.05), 0.0, abs_tol=1e-9)
    assert agreement(grid, robot.grid, robot.map_from_world.inverse()) > 0.9


def test_a_large_extent_costs_only_what_was_seen() -> None:
    robot, slam = in_room(3, GmappingConfig())
    errors_along(robot, slam, laps((3.0,), 1))
    assert slam.grid().cells.shape == (4000, 4000)
    assert slam.maps.tiles * 8192 < 40e6


def test_transforms_go_out_while_a_scan_is_matched() -> None:
    """A thread that wakes every millisecond is blocked for less than half of a long scan match."""
    robot, slam = in_room(1, dataclasses.replace(CONFIG, particles=400, kernelSize=2))
    slam.observe(robot.odom, robot.scan(360), 0.0)
    robot.drive(1.1, 0.0)
    scan, wakes, done = robot.scan(360), list[float](), threading.Event()

    def wake() -> None:
        while not done.wait(0.001):
            wakes.append(time.monotonic())

    sender = threading.Thread(target=wake)
    sender.start()
    begin = time.monotonic()
    assert slam.observe(robot.odom, scan, 1.0)
    end = time.monotonic()
    done.set()
    sender.join()
    standstill = max(after - before for before, after in pairwise([begin, *wakes, end]))
    assert standstill < 0.5 * (end - begin)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("particles", 0),
        ("delta", 0.0),
        ("xmax", -200.0),
        ("sigma", -1.0),
        ("occ_thresh", 2.0),
        ("throttle_scans", 0),
    ],
)
def test_values_out_of_range_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"~{name} must"):
        dataclasses.replace(GmappingConfig(), **{name: value})


def half_scan(robot: FakeRobot, mount: Pose) -> Scan:
    """Returns the scan of a laser at ``mount`` that sees half a circle ahead of itself."""
    ranges = ranges_at(robot.grid, robot.pose, mount, 180, 12.0)[45:135]
    seen = np.where(ranges < 12.0, ranges, np.inf).astype(np.float32)
    return Scan(seen, -math.pi + 45 * math.tau / 179, math.tau / 179, 0.1, 12.0, mount)


def test_two_lasers_draw_one_map() -> None:
    """The way from one laser to the other on the robot used to count as the robot's movement."""
    robot, slam = in_room(0)
    mounts = {"front": Pose(0.2, 0.0, 0.0), "rear": Pose(-0.2, 0.0, math.pi)}
    used = []
    for number, step in enumerate([(0.0, 0.0), *laps((6.3, 3.8), 1)]):
        robot.drive(*step)
        for name, mount in mounts.items():
            if slam.observe(robot.odom, half_scan(robot, mount), 0.1 * number, name):
                used.append(name)
    assert used == ["front", "rear"] * (len(used) // 2)
    assert slam.map_from_odom is not None
    found = robot.map_from_world.inverse().compose(slam.map_from_odom.compose(robot.odom))
    assert found.distance(robot.pose) < 0.08
    assert abs(angle_difference(found.yaw, robot.pose.yaw)) < 0.03
