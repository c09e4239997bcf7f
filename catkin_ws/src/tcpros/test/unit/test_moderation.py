"""When a relay rests."""

from hypothesis import given
from hypothesis import strategies as st

from tcpros.moderation import REST, SMALL, SOON, STREAK, Moderation

FLOOD = 1.0 / 12_500.0
"""Of small messages that come one by one [s]."""


def rests(pauses: list[float], moved: list[int]) -> list[float]:
    """Returns the rest after each round; each round ends `pause` after the previous rest."""
    moderation, now, found = Moderation(), 0.0, [0.0]
    for pause, count in zip(pauses, moved, strict=True):
        now += found[-1] + pause
        found.append(moderation.rest(now, count))
    return found[1:]


def test_a_flood_of_small_messages_is_taken_some_at_a_time_for_as_long_as_it_lasts() -> None:
    found = rests([FLOOD] * 1000, [104] * 1000)
    assert found == [0.0] * STREAK + [REST] * (1000 - STREAK)


@given(st.lists(st.tuples(st.floats(SOON, 10.0), st.integers(0, 10**9)), max_size=50))
def test_messages_that_come_slower_are_never_delayed(rounds: list[tuple[float, int]]) -> None:
    assert not any(rests([pause for pause, _ in rounds], [count for _, count in rounds]))


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.integers(SMALL + 1, 10**9)), max_size=50))
def test_large_messages_are_never_delayed(rounds: list[tuple[float, int]]) -> None:
    assert not any(rests([pause for pause, _ in rounds], [count for _, count in rounds]))


def test_a_flood_that_is_over_delays_nothing_after_it() -> None:
    assert (
        rests([FLOOD] * 20 + [SOON] + [FLOOD] * (STREAK - 1), [104] * (20 + STREAK))[20:]
        == [0.0] * STREAK
    )


def test_rounds_about_something_else_change_nothing() -> None:
    moderation = Moderation()
    found = [
        moderation.rest(FLOOD * number, 104 if number % 2 else 0) for number in range(4 * STREAK)
    ]
    assert not any(found[::2])
    assert found[-1] == REST
