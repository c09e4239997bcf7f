"""Messages stamped before the clock jumped back are distinguished from current ones."""

import pytest

from nav_bundle.base.transform_store import ClockJump


@pytest.fixture
def clock() -> ClockJump:
    made = ClockJump()
    assert not made.jumped(46.0)
    assert not made.jumped(46.5)
    return made


def test_before_any_jump_every_stamp_is_of_now(clock: ClockJump) -> None:
    """This includes stamps from a robot whose clock is ahead."""
    assert not clock.is_of_before(99.0)


def test_a_transform_after_the_jump_differs_from_one_stamped_ahead(clock: ClockJump) -> None:
    assert clock.jumped(0.01)
    assert clock.is_of_before(46.5)
    assert not clock.is_of_before(0.02)
    assert not clock.is_of_before(1.02)
    assert not clock.jumped(0.02)
    assert clock.is_of_before(46.5)


def test_a_second_jump_still_knows_how_far_time_had_come(clock: ClockJump) -> None:
    clock.jumped(2.0)
    assert clock.jumped(0.0)
    assert clock.is_of_before(46.5)


def test_when_time_has_come_as_far_again_every_stamp_is_of_now(clock: ClockJump) -> None:
    clock.jumped(0.01)
    clock.jumped(46.6)
    assert not clock.is_of_before(99.0)
