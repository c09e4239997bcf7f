import itertools

import pytest

from pioneer_fleet.monitor.tour import places_from_mapping, tour

PLACES = [(float(number), 0.0, 0.0) for number in range(15)]


@pytest.mark.parametrize("robots", [1, 2, 5, 7, 10, 14, 15])
def test_no_two_robots_of_a_round_have_the_same_place(robots: int) -> None:
    tours = [tour(PLACES, number, robots, 4) for number in range(1, robots + 1)]
    for places in zip(*tours, strict=True):
        assert len(set(places)) == robots


@pytest.mark.parametrize("robots", range(1, 16))
def test_every_waypoint_is_somewhere_else(robots: int) -> None:
    for number in range(1, robots + 1):
        way = [PLACES[number - 1], *tour(PLACES, number, robots, 2)]
        assert all(one != other for one, other in itertools.pairwise(way))


def test_the_first_round_of_a_small_fleet_goes_to_free_places() -> None:
    assert [tour(PLACES, number, 5, 1)[0] for number in range(1, 6)] == PLACES[5:10]


def test_places_are_those_of_consecutive_robots() -> None:
    pose = {"x": 1, "y": 2, "a": 0.5}
    parameters = {
        "pioneer1": pose,
        "pioneer2": {**pose, "tf_prefix": "pioneer2"},
        "pioneer4": pose,
        "gazebo": {},
    }
    assert places_from_mapping(parameters) == [(1.0, 2.0, 0.5)] * 2
