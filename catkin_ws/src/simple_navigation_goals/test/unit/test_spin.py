"""A robot that stands still with a goal is turned after 5 s, for 1.5 s, in the direction last commanded."""

from simple_navigation_goals.spin import SpinState, blinded, commanded, watched

MAX_VEL_THETA = 1.0
Command = tuple[float, float] | None


def run(
    seconds: float, command: Command = None, state: SpinState | None = None, active: bool = True
) -> SpinState:
    """Returns the state after ``seconds`` of status messages at 5 Hz, each after ``command`` (linear, angular)."""
    state = state or SpinState()
    start = state.now
    for step in range(1, round(seconds * 5) + 1):
        now = start + 0.2 * step
        if command:
            state = commanded(state, MAX_VEL_THETA, *command, now)
        state = watched(state, active, now)
    return state


def test_silence_with_an_active_goal_counts_as_standing() -> None:
    assert not run(5.0).turning
    assert run(5.4).turning


def test_a_robot_that_drives_is_left_alone() -> None:
    assert not run(20.0, (0.3, 0.0)).turning


def test_a_robot_that_turns_at_full_speed_is_left_alone() -> None:
    assert not run(20.0, (0.0, -1.0)).turning


def test_a_robot_that_turns_slowly_counts_as_standing_and_is_turned_that_way() -> None:
    state = run(5.6, (0.0, -0.4))
    assert state.turning
    assert state.direction == -1.0


def test_a_turn_under_way_keeps_its_side() -> None:
    turning = run(5.6, (0.0, -0.4))
    assert commanded(turning, MAX_VEL_THETA, 0.0, 0.4, turning.now + 0.1).direction == -1.0


def test_without_an_active_goal_nothing_turns() -> None:
    assert not run(20.0, active=False).turning


def test_a_turn_ends_after_its_time_and_the_wait_starts_over() -> None:
    turning = run(5.4)
    assert run(1.2, state=turning).turning
    after = run(1.8, state=turning)
    assert not after.turning
    assert not run(4.6, state=after).turning
    assert run(5.6, state=after).turning


def test_a_goal_that_ends_ends_the_turn() -> None:
    turning = run(5.4)
    assert not watched(turning, False, turning.now + 0.1).turning


def test_time_that_jumps_back_starts_the_wait_over() -> None:
    state = run(4.8)
    state = watched(state, True, 0.1)
    assert not run(4.8, state=state).turning


def test_a_robot_that_its_safety_stop_holds_is_not_turned() -> None:
    blind = blinded(SpinState(), True, 0.0)
    assert not run(20.0, (0.0, 0.0), state=blind).turning


def test_a_safety_stop_ends_a_turn_at_once_and_the_wait_starts_over_after_it() -> None:
    turning = run(5.4)
    blind = blinded(turning, True, turning.now + 0.1)
    assert not blind.turning
    sighted = blinded(run(3.0, state=blind), False, blind.now + 3.1)
    assert not run(4.6, state=sighted).turning
    assert run(5.6, state=sighted).turning
