"""The bench's own trials: the simulated Pioneer moves, stops and senses as it should."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from pioneer_bench.accuracy import Worlds
from pioneer_bench.adapters.description import meshed_pioneer, pioneer_urdf
from pioneer_bench.core import accuracy
from pioneer_bench.core.row import Row
from pioneer_gazebo.world.robot import Robot
from pioneer_gazebo.world.urdf import robot_from_urdf


@pytest.fixture(scope="module", params=["shapes", "meshes"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    if request.param == "meshes":
        return meshed_pioneer(tmp_path_factory.mktemp("meshes"))
    return robot_from_urdf(pioneer_urdf())


@pytest.fixture
def worlds() -> Iterator[Worlds]:
    with Worlds() as worlds:
        yield worlds


def missed(rows: Iterator[Row]) -> list[tuple[str, str, float | None]]:
    found = list(rows)
    assert found
    return [(row.what, row.unit, row.median) for row in found if not row.holds]


@pytest.mark.parametrize("name", accuracy.MOTIONS)
def test_a_run_ends_where_it_was_commanded_and_odometry_agrees(
    worlds: Worlds, robot: Robot, name: str
) -> None:
    assert not missed(accuracy.motion_rows(worlds.make, robot, name, accuracy.MOTIONS[name]))


def test_a_wall_is_neither_entered_nor_climbed_at_full_speed(worlds: Worlds, robot: Robot) -> None:
    assert not missed(accuracy.wall_rows(worlds.make, robot))


def test_a_robot_that_was_told_to_stop_stands_still_for_thirty_seconds(
    worlds: Worlds, robot: Robot
) -> None:
    assert not missed(accuracy.standstill_rows(worlds.make, robot))


def test_scans_are_those_of_geometry_and_noise_is_as_asked(worlds: Worlds, robot: Robot) -> None:
    assert not missed(accuracy.laser_rows(worlds.make, robot))


def test_expected_ranges_end_at_the_walls_and_at_the_pillar() -> None:
    ranges = accuracy.expected_ranges(0.0, 1.0, np.array([0.0, math.pi / 2, math.pi]))
    np.testing.assert_allclose(ranges, [2.1, 3.0, 5.0])


def test_a_square_leads_back_to_its_begin() -> None:
    pose = accuracy.Pose()
    for leg in accuracy.MOTIONS["square, 2 m a side"]:
        pose = pose.compose(leg.motion)
    assert math.hypot(*pose.position) < 1e-9
    assert abs(math.remainder(pose.yaw, math.tau)) < 1e-9
