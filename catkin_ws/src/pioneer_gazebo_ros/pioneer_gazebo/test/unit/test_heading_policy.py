"""Headings of the learned driver."""

import math

import numpy as np

from pioneer_gazebo.learning.heading_policy import act, directions, sectors

WEIGHTS = np.array([1.0, 0.3, 2.0, 1.0, 0.5])
OPEN = np.full(180, 30.0)


def test_in_the_open_it_drives_straight_to_the_goal() -> None:
    assert act(WEIGHTS, OPEN, 3.0, 0.0) == (1.0, 0.0)
    speed, turn = act(WEIGHTS, OPEN, 3.0, math.pi / 2)
    assert speed < 0.3
    assert turn == 1.0


def test_it_turns_away_from_what_stands_on_the_way_to_the_goal() -> None:
    ranges = OPEN.copy()
    ranges[70:95] = 0.8  # an obstacle ahead, mostly to the right
    speed, turn = act(WEIGHTS, ranges, 3.0, 0.0)
    assert turn > 0.2
    assert speed < 1.0


def test_sectors_begin_straight_behind() -> None:
    ranges = OPEN.copy()
    ranges[90] = 0.5
    nearest = int(sectors(ranges).argmin())
    assert abs(directions()[nearest]) < math.radians(6.0)
