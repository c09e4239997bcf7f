"""Roadmaps are connected and lie in free space, with enough spacing that only places and ways matter."""

import numpy as np
import pytest

from pioneer_traffic.core.geometry import distance_between_segments, distance_to_segment
from pioneer_traffic.core.roadmap import FreeSpace, Roadmap, RoadmapConfig, roadmap_from_space

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
    ways = [(one, other) for one, near in enumerate(rooms.neighbours) for other in near if one < other]
    least = rooms.config.clearance - 1e-6
    for way in ways:
        segment = rooms.places[way[0]], rooms.places[way[1]]
        for place, at in enumerate(rooms.places):
            assert place in way or distance_to_segment(at, *segment) >= least
        for other in ways:
            if not set(way) & set(other):
                assert distance_between_segments(segment, (rooms.places[other[0]], rooms.places[other[1]])) >= least


def test_ways_keep_off_the_walls(rooms: Roadmap) -> None:
    assert rooms.space is not None
    for one, near in enumerate(rooms.neighbours):
        for other in near:
            assert rooms.space.sees(rooms.places[one], rooms.places[other], rooms.config.passing_radius)


def test_a_map_without_room_has_no_places() -> None:
    assert roadmap_from_space(space_of(["###", "###"])).places == []


def test_the_same_map_gives_the_same_signature_and_other_parameters_another_one(rooms: Roadmap) -> None:
    assert roadmap_from_space(space_of(ROOMS)).signature == rooms.signature
    assert roadmap_from_space(space_of(ROOMS), RoadmapConfig(spacing=1.2)).signature != rooms.signature


def test_two_robots_off_the_ways_that_hold_nothing_in_common_are_a_clearance_apart(rooms: Roadmap) -> None:
    generator = np.random.default_rng(1)
    for _ in range(300):
        (a, b, c, d) = (tuple(point) for point in generator.uniform((0.0, 5.0), (6.0, 10.0), (4, 2)).tolist())
        if not rooms.near(a, b) & rooms.near(c, d):
            assert distance_between_segments((a, b), (c, d)) >= rooms.config.clearance - 1e-6
