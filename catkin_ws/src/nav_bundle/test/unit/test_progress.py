"""Progress towards a goal: what counts as progress, and that no goal outlasts its bound."""

from hypothesis import given, settings
from hypothesis import strategies as st

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import Velocity
from nav_bundle.move_base.progress import Progress, ProgressLimits
from nav_bundle.move_base.state_machine import (
    STALE_TEXT,
    Finish,
    Inputs,
    Limits,
    Outcome,
    PlanOutcome,
    StartPlanning,
    StartRecovery,
    State,
    Trigger,
    advance,
)

alike = settings(derandomize=True, deadline=None, max_examples=60)
PERIOD = 0.1
PATIENCE, RECOVERIES = 5.0, 4
LIMITS = ProgressLimits(patience=PATIENCE, recoveries=RECOVERIES)
LONGEST = LIMITS.timeout + PATIENCE * RECOVERIES
"""Time without progress until a goal is given up [s], without the recovery behaviours themselves."""


class Drive:
    """Runs the state machine of a robot that always finds a plan and a velocity."""

    def __init__(self, progress: ProgressLimits = LIMITS) -> None:
        self.limits = Limits(
            planner_frequency=0.5, recoveries=progress.recoveries, progress=progress
        )
        self.now = 0.0
        self.recoveries: list[int] = []
        self.finish: Finish | None = None
        self.state, _, events = advance(
            State(), Inputs(new_goal=True, pose=Pose()), 0.0, self.limits
        )
        self.is_planning = StartPlanning() in events

    def cycle(
        self, remaining: float | None, discovered: bool = False, current: bool = True
    ) -> None:
        """Runs a cycle in which the remaining way is ``remaining`` [m]."""
        self.now += PERIOD
        inputs = Inputs(
            pose=Pose(),
            current=current,
            plan=PlanOutcome.FOUND if self.is_planning else PlanOutcome.NONE,
            control=Velocity(0.5),
            recovered=self.state.recovering,
            remaining=remaining,
            discovered=discovered,
        )
        self.state, _, events = advance(self.state, inputs, self.now, self.limits)
        self.is_planning = StartPlanning() in events
        self.recoveries += [event.index for event in events if isinstance(event, StartRecovery)]
        self.finish = next((event for event in events if isinstance(event, Finish)), self.finish)


ways = st.lists(st.floats(5.0, 20.0), min_size=1, max_size=40)
"""Remaining ways [m] of a robot that changes its plan again and again."""


@alike
@given(ways, st.lists(st.booleans(), min_size=1, max_size=40))
def test_a_robot_that_drives_to_and_fro_gives_up_within_its_bound(
    ways: list[float], discoveries: list[bool]
) -> None:
    drive = Drive()
    worst = (LIMITS.resets + 1) * 15.0 / LIMITS.distance * LONGEST
    step = 0
    while drive.finish is None:
        way = ways[step // 20 % len(ways)]
        discovered = discoveries[step // 20 % len(discoveries)] and step % 20 == 0
        drive.cycle(way, discovered)
        step += 1
        assert drive.now < worst
    assert drive.finish.outcome is Outcome.ABORTED
    assert drive.finish.trigger in (Trigger.PROGRESS, Trigger.TIME)


@alike
@given(st.floats(0.06, 1.0), st.floats(1.0, 30.0))
def test_a_robot_that_makes_progress_is_left_alone(speed: float, way: float) -> None:
    """Even a slow robot makes half a metre in the time that is allowed."""
    drive = Drive(ProgressLimits(patience=PATIENCE, recoveries=RECOVERIES, scale=0.0))
    while way - speed * drive.now > 0.0:
        drive.cycle(way - speed * drive.now)
        assert drive.finish is None
        assert not drive.recoveries


def test_without_progress_all_recoveries_run_in_order_and_the_goal_is_aborted_in_time() -> None:
    drive = Drive()
    while drive.finish is None:
        drive.cycle(4.0)
        assert drive.now < 45.0
    assert drive.recoveries == [0, 1, 2, 3]
    assert drive.now > LONGEST
    assert drive.finish == Finish(Outcome.ABORTED, Trigger.PROGRESS.value, Trigger.PROGRESS)


def test_plans_that_are_found_again_and_again_do_not_count_as_progress() -> None:
    """Between two ways of 6 and 4 m the remaining way becomes shorter each time, but never shorter than before."""
    drive = Drive()
    while drive.finish is None:
        drive.cycle(6.0 if drive.now % 10.0 < 5.0 else 4.0)
        assert drive.now < 70.0


def test_a_longer_way_round_an_obstacle_found_on_the_way_restarts_the_watch() -> None:
    drive = Drive()
    drive.cycle(5.0)
    drive.cycle(30.0, discovered=True)
    for step in range(400):
        drive.cycle(30.0 - 0.05 * step)
    assert drive.finish is None
    assert not drive.recoveries


def test_the_watch_restarts_only_so_often() -> None:
    drive = Drive()
    step = 0
    while drive.finish is None:
        drive.cycle(10.0, discovered=step % 30 == 0)
        step += 1
        assert drive.now < (LIMITS.resets + 1) * LONGEST + 1.0
    assert drive.state.progress == Progress()


def test_a_goal_ends_after_its_total_time_though_it_makes_progress() -> None:
    drive = Drive(ProgressLimits(scale=10.0, least_total=20.0, speed=1.0))
    while drive.finish is None:
        drive.cycle(5.0 - 0.05 * drive.now)
        assert drive.now < 51.0
    assert (drive.finish.text, round(drive.now)) == (Trigger.TIME.value, 50)


def test_a_robot_whose_sensors_fail_gives_up_too() -> None:
    drive = Drive()
    drive.cycle(5.0)
    while drive.finish is None:
        drive.cycle(None, current=False)
        assert drive.now < 45.0
    assert drive.finish == Finish(Outcome.ABORTED, STALE_TEXT, Trigger.SENSORS)


def test_without_a_timeout_nothing_is_watched() -> None:
    drive = Drive(ProgressLimits(timeout=0.0, scale=0.0))
    for _ in range(3000):
        drive.cycle(5.0)
    assert drive.finish is None
    assert not drive.recoveries
