"""Roadmaps are connected and lie in free space, with enough spacing that only places and ways matter."""

import dataclasses
import math

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.maps.grid import Grid
from pioneer_traffic.coordinator import Coordinator
from pioneer_traffic.geometry import distance_between_segments, distance_to_segment
from pioneer_traffic.roadmap import FreeSpace, Roadmap, RoadmapConfig, roadmap_from_space

ROOMS = [
    "##################",
    "#......##........#",
    "#......##........#",
    "#................#",
    "#......##........#",
    "#......##........#",
    "####.#####.#######",
    "####.#####.#######",
    "#................#",
    "#......#.........#",
    "##################",
]
CELL = 18
"""Grid cells of 0.05 m per character: passages are 0.9 m wide."""


def space_of(drawing: list[str]) -> FreeSpace:
    free = np.array([[cell == "." for cell in line] for line in drawing[::-1]])
    return FreeSpace.of(np.kron(free, np.ones((CELL, CELL), bool)), 0.05, (-2.0, 3.0))


@pytest.fixture(scope="module")
def rooms() -> Roadmap:
    return roadmap_from_space(space_of(ROOMS))


def test_every_place_can_be_reached_from_every_other(rooms: Roadmap) -> None:
    assert len(rooms.places) > 40
    assert max(rooms.distances(0)) < len(rooms.places)


def test_robots_at_places_and_ways_that_share_no_end_are_a_clearance_apart(rooms: Roadmap) -> None:
    ways = [
        (one, other) for one, near in enumerate(rooms.neighbours) for other in near if one < other
    ]
    least = rooms.config.clearance - 1e-6
    for way in ways:
        segment = rooms.places[way[0]], rooms.places[way[1]]
        for place, at in enumerate(rooms.places):
            assert place in way or distance_to_segment(at, *segment) >= least
        for other in ways:
            if not set(way) & set(other):
                assert (
                    distance_between_segments(
                        segment, (rooms.places[other[0]], rooms.places[other[1]])
                    )
                    >= least
                )


def test_ways_keep_off_the_walls(rooms: Roadmap) -> None:
    assert rooms.space is not None
    for one, near in enumerate(rooms.neighbours):
        for other in near:
            assert rooms.space.sees(
                rooms.places[one], rooms.places[other], rooms.config.passing_radius
            )


def test_a_map_without_room_has_no_places() -> None:
    assert roadmap_from_space(space_of(["###", "###"])).places == []


def test_the_same_map_gives_the_same_signature_and_other_parameters_another_one(
    rooms: Roadmap,
) -> None:
    assert roadmap_from_space(space_of(ROOMS)).signature == rooms.signature
    assert (
        roadmap_from_space(space_of(ROOMS), RoadmapConfig(spacing=1.2)).signature != rooms.signature
    )


@pytest.mark.parametrize("yaw", [0.5, -2.0, math.pi / 2.0])
def test_a_turned_map_gives_the_same_roadmap_turned(rooms: Roadmap, yaw: float) -> None:
    """The origin's yaw used to be ignored."""
    space = space_of(ROOMS)
    turned = roadmap_from_space(dataclasses.replace(space, yaw=yaw))
    assert len(turned.places) > 40
    origin = Pose(*space.corner, yaw)
    for x, y in turned.places:
        along, across = origin.inverse().apply(x, y)
        here = np.array([[along + space.corner[0], across + space.corner[1]]])
        assert space.room_at(here)[0] >= turned.config.driving_radius - 0.05


def test_cells_that_map_saver_calls_free_are_free() -> None:
    """A map of probabilities has free cells above 0, which used to count as walls."""
    free = np.kron(space_of(ROOMS).room > 0.0, np.ones((1, 1))) > 0
    cells = np.where(free, 12, 100).astype(np.int8)
    space = FreeSpace.of_grid(Grid(0.05, Pose(-2.0, 3.0, 0.0), cells))
    assert len(roadmap_from_space(space).places) > 40
    unknown = FreeSpace.of_grid(
        Grid(0.05, Pose(-2.0, 3.0, 0.0), np.where(free, -1, 100).astype(np.int8))
    )
    assert roadmap_from_space(unknown).places == []


def test_a_waypoint_in_a_wall_is_refused(rooms: Roadmap) -> None:
    """A start in a wall made every line free, also those through other walls."""
    assert rooms.space is not None
    generator = np.random.default_rng(2)
    low, high = np.array(rooms.places).min(axis=0) - 1.0, np.array(rooms.places).max(axis=0) + 1.0
    for x, y in generator.uniform(low, high, (300, 2)).tolist():
        is_wall = rooms.space.room_at(np.array([[x, y]]))[0] == 0.0
        if is_wall:
            assert not Coordinator("a", rooms).set_waypoint((x, y), 0.0)


def test_a_robot_whose_position_reads_as_wall_enters_only_on_its_side(rooms: Roadmap) -> None:
    assert rooms.space is not None
    generator = np.random.default_rng(3)
    low, high = np.array(rooms.places).min(axis=0), np.array(rooms.places).max(axis=0)
    for point in generator.uniform(low, high, (300, 2)).tolist():
        for place in rooms.entries((point[0], point[1])):
            steps = np.linspace(point, rooms.places[place], 60)
            is_free = rooms.space.room_at(steps) > 0.0
            assert (np.diff(is_free.astype(int)) >= 0).all()


def test_two_robots_off_the_ways_that_hold_nothing_in_common_are_a_clearance_apart(
    rooms: Roadmap,
) -> None:
    generator = np.random.default_rng(1)
    for _ in range(300):
        (a, b, c, d) = (
            tuple(point) for point in generator.uniform((0.0, 5.0), (6.0, 10.0), (4, 2)).tolist()
        )
        if not rooms.near(a, b) & rooms.near(c, d):
            assert distance_between_segments((a, b), (c, d)) >= rooms.config.clearance - 1e-6
