"""Only simulated time that starts again is a reset: a clock that is set back is none."""

import numpy as np
import pytest

from nav_bundle.base.clock import RESET, STALL, ClockWatch, Jump, StallWatch


def test_time_that_goes_on_does_not_jump():
    watch = ClockWatch(simulated=True)
    assert {watch.read(now) for now in (5.0, 5.0, 6.0, 1e9)} == {Jump.NONE}


@pytest.mark.parametrize(
    ("simulated", "back", "jump"),
    [
        (True, 0.2, Jump.STEP),
        (True, 46.0, Jump.RESET),
        (False, 0.2, Jump.STEP),
        (False, 3600.0, Jump.STEP),
    ],
)
def test_a_reset_is_known_by_simulated_time_that_goes_far_back(simulated, back, jump):
    watch = ClockWatch(simulated)
    watch.read(5000.0)
    assert watch.read(5000.0 - back) is jump
    assert watch.read(5000.1 - back) is Jump.NONE


def test_messages_of_the_clock_that_overtake_each_other_are_no_reset():
    generator = np.random.default_rng(8)
    watch = ClockWatch(simulated=True)
    times = np.arange(0.0, 100.0, 0.01)
    for now in times + generator.uniform(0.0, RESET, len(times)):
        assert watch.read(float(now)) is not Jump.RESET


def test_a_clock_stands_still_only_after_a_while_of_wall_time():
    watch = StallWatch()
    assert not watch.read(0.0, 100.0)
    assert not watch.read(7.0, 100.0 + 2.0 * STALL)
    assert not watch.read(7.0, 100.0 + 3.0 * STALL)
    assert watch.read(7.0, 100.1 + 3.0 * STALL)
    assert not watch.read(6.9, 100.2 + 3.0 * STALL), "set back, it continues"


def test_a_slow_simulation_does_not_stand_still():
    watch = StallWatch()
    ticks = np.arange(0.0, 100.0, 0.9 * STALL)
    assert not any(watch.read(0.01 * tick, float(tick)) for tick in ticks)
