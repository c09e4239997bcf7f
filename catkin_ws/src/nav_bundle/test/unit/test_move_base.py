"""move_base's state machine: its transitions, and when it gives up."""

import math
from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import Point, Quaternion
from geometry_msgs.msg import Pose as PoseMessage

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.move_base.action_server import GoalError, check_goal
from nav_bundle.move_base.config import setup_from_parameters
from nav_bundle.move_base.state_machine import (
    STALE_TEXT,
    Finish,
    FollowPlan,
    Inputs,
    Limits,
    Outcome,
    Phase,
    PlanOutcome,
    StartPlanning,
    StartRecovery,
    State,
    Trigger,
    Warn,
    advance,
)
from nav_bundle.planning.global_planner import GlobalPlanner
from nav_bundle.planning.navfn import NavfnPlanner
from pioneer_node.core.parameter import ParameterError

LIMITS = Limits(planner_frequency=0.5, recoveries=4)
GO = Velocity(0.5)
PERIOD = 0.05


class Machine:
    """Runs the state machine at 20 Hz and keeps its latest output."""

    def __init__(self, limits=LIMITS):
        self.limits, self.state, self.now, self.command = limits, State(), 0.0, None
        self.events = []

    def cycle(self, **inputs):
        self.now += PERIOD
        self.state, self.command, self.events = advance(
            self.state, Inputs(**inputs), self.now, self.limits
        )
        return self.events

    def until(self, condition, seconds=60.0, **inputs):
        end = self.now + seconds
        while not condition(self):
            assert self.now < end, f"still {self.state} after {seconds} s"
            self.cycle(**inputs)

    def drive(self):
        self.cycle(new_goal=True, pose=Pose())
        self.cycle(plan=PlanOutcome.FOUND, pose=Pose())


def finish(machine):
    return next((event for event in machine.events if isinstance(event, Finish)), None)


def test_without_a_goal_it_leaves_the_base_alone():
    machine = Machine()
    assert machine.cycle() == ()
    assert machine.command is None


def test_a_goal_starts_planning_and_a_plan_starts_driving():
    machine = Machine()
    assert StartPlanning() in machine.cycle(new_goal=True, pose=Pose())
    assert (machine.state.phase, machine.command) == (Phase.PLANNING, STANDSTILL)
    assert FollowPlan() in machine.cycle(plan=PlanOutcome.FOUND, pose=Pose())
    assert machine.state.phase is Phase.CONTROLLING
    machine.cycle(control=GO)
    assert machine.command == GO


def test_a_robot_that_pushes_recovers_and_gives_up_after_the_last_behaviour():
    machine = Machine()
    machine.drive()
    for index in range(LIMITS.recoveries):
        assert any(
            isinstance(event, Warn)
            for event in machine.cycle(control=GO, pushing=True, pose=Pose())
        )
        assert (machine.state.phase, machine.command) == (Phase.CLEARING, STANDSTILL)
        assert machine.cycle(pose=Pose()) == (StartRecovery(index, Trigger.PUSHING),)
        machine.cycle(recovered=True, pose=Pose())
        machine.until(lambda machine: StartPlanning() in machine.events, pose=Pose())
        machine.cycle(plan=PlanOutcome.FOUND, pose=Pose())
    machine.cycle(control=GO, pushing=True, pose=Pose())
    machine.cycle(pose=Pose())
    assert finish(machine) == Finish(Outcome.ABORTED, Trigger.PUSHING.value, Trigger.PUSHING)


def test_reaching_the_goal_ends_it_with_noetic_s_text():
    machine = Machine()
    machine.drive()
    machine.cycle(reached=True)
    assert finish(machine) == Finish(Outcome.SUCCEEDED, "Goal reached.")
    assert (machine.state.phase, machine.command) == (Phase.IDLE, STANDSTILL)


def test_while_driving_it_plans_at_the_planner_frequency():
    machine, plans = Machine(), []
    machine.drive()
    pending = False
    for _ in range(200):
        events = machine.cycle(control=GO, plan=PlanOutcome.FOUND if pending else PlanOutcome.NONE)
        pending = StartPlanning() in events
        plans += [machine.now] * pending
    assert len(plans) == pytest.approx(5, abs=1)


def test_without_a_planner_frequency_it_plans_once():
    machine = Machine(replace(LIMITS, planner_frequency=0.0))
    machine.drive()
    assert not any(StartPlanning() in machine.cycle(control=GO) for _ in range(200))


def test_with_somebody_near_plans_age_fast():
    machine = Machine(replace(LIMITS, planner_frequency=0.1))
    machine.drive()
    machine.until(lambda m: StartPlanning() in m.events, 0.6, control=GO, meeting=True)


@pytest.mark.parametrize("meeting", [False, True])
def test_failing_plans_repeat_at_the_planner_frequency_near_unmapped_obstacles_too(meeting):
    machine = Machine(replace(LIMITS, planner_frequency=2.0, meeting_period=0.5))
    machine.drive()
    searches = 0
    is_searching = False
    for _ in range(round(10.0 / PERIOD)):
        outcome = PlanOutcome.FAILED if is_searching else PlanOutcome.NONE
        is_searching = StartPlanning() in machine.cycle(
            control=GO, meeting=meeting, blocked=meeting, plan=outcome
        )
        searches += is_searching
    assert machine.state.phase is Phase.CONTROLLING
    assert 16 <= searches <= 20


def test_a_failed_plan_while_driving_keeps_the_old_one():
    machine = Machine()
    machine.drive()
    machine.cycle(control=GO, plan=PlanOutcome.FAILED)
    assert (machine.state.phase, machine.command) == (Phase.CONTROLLING, GO)


def test_stale_sensors_stop_the_robot_in_the_same_cycle():
    machine = Machine()
    machine.drive()
    machine.cycle(control=GO)
    assert machine.cycle(current=False) == (Warn(STALE_TEXT),)
    assert machine.command == STANDSTILL
    machine.cycle(control=GO)
    assert machine.command == GO


def test_a_cancelled_goal_is_preempted_and_the_robot_stops():
    machine = Machine()
    machine.drive()
    machine.cycle(cancel=True)
    assert finish(machine) == Finish(Outcome.PREEMPTED, "")
    assert machine.command == STANDSTILL


def test_a_new_goal_replaces_the_one_under_way_while_the_robot_drives_on():
    machine = Machine()
    machine.drive()
    assert machine.cycle(new_goal=True, pose=Pose()) == (StartPlanning(),)
    assert (machine.state.phase, machine.command) == (Phase.CONTROLLING, None)
    machine.cycle(control=GO)
    assert machine.command == GO
    assert machine.cycle(plan=PlanOutcome.FOUND, control=GO) == (FollowPlan(),)
    assert (machine.command, machine.state.follows_earlier) == (GO, False)


def test_the_end_of_the_earlier_plan_is_not_the_new_goal():
    machine = Machine()
    machine.drive()
    machine.cycle(new_goal=True, pose=Pose())
    machine.cycle(control=STANDSTILL, reached=True)
    assert machine.state.phase is Phase.CONTROLLING
    machine.cycle(plan=PlanOutcome.FOUND, control=STANDSTILL, reached=True)
    assert finish(machine) is None
    machine.cycle(reached=True)
    assert finish(machine) == Finish(Outcome.SUCCEEDED, "Goal reached.")


def test_the_remaining_way_to_an_earlier_goal_is_no_progress():
    machine = Machine()
    machine.drive()
    machine.cycle(control=GO, remaining=1.0)
    machine.cycle(new_goal=True, pose=Pose())
    machine.cycle(control=GO, remaining=0.5)
    assert math.isinf(machine.state.progress.least)
    machine.cycle(plan=PlanOutcome.FOUND, control=GO)
    machine.cycle(control=GO, remaining=9.0)
    assert machine.state.progress.least == 9.0


def test_a_search_to_an_earlier_goal_is_followed_by_one_to_the_newest():
    machine = Machine()
    machine.drive()
    machine.cycle(new_goal=True, pose=Pose())
    earlier = machine.state.goal
    machine.cycle(new_goal=True, pose=Pose())
    events = machine.cycle(plan=PlanOutcome.FOUND, searched_goal=earlier, control=GO)
    assert (events, machine.command) == ((FollowPlan(), StartPlanning()), GO)
    assert machine.state.follows_earlier


def test_the_first_failed_search_for_a_new_goal_stops_the_robot():
    machine = Machine()
    machine.drive()
    machine.cycle(new_goal=True, pose=Pose())
    machine.cycle(plan=PlanOutcome.FAILED, control=GO)
    assert (machine.state.phase, machine.command) == (Phase.PLANNING, STANDSTILL)
    machine.until(lambda m: m.state.phase is Phase.CLEARING, plan=PlanOutcome.FAILED)
    assert machine.now == pytest.approx(5.0, abs=0.5)


def test_a_failed_search_for_the_earlier_goal_does_not_stop_the_robot():
    machine = Machine()
    machine.drive()
    earlier = machine.state.goal
    machine.cycle(new_goal=True, pose=Pose())
    events = machine.cycle(plan=PlanOutcome.FAILED, searched_goal=earlier, control=GO)
    assert (events, machine.command) == ((StartPlanning(),), GO)


def test_without_control_it_plans_again_until_patience_ends():
    machine = Machine()
    machine.drive()
    assert StartPlanning() in machine.cycle()
    assert (machine.state.phase, machine.command) == (Phase.PLANNING, STANDSTILL)
    machine.until(lambda m: m.state.phase is Phase.CLEARING, plan=PlanOutcome.FOUND)
    assert machine.state.trigger is Trigger.CONTROLLING
    assert machine.now == pytest.approx(15.0, abs=0.5)


def test_without_a_plan_it_gives_up_after_the_planner_s_patience():
    machine = Machine()
    machine.cycle(new_goal=True, pose=Pose())
    machine.until(lambda m: m.state.phase is Phase.CLEARING, plan=PlanOutcome.FAILED)
    assert machine.state.trigger is Trigger.PLANNING
    assert machine.now == pytest.approx(5.0, abs=0.5)


def test_planning_retries_are_counted_where_they_are_limited():
    machine = Machine(replace(LIMITS, max_planning_retries=2))
    machine.cycle(new_goal=True, pose=Pose())
    machine.until(lambda m: m.state.phase is Phase.CLEARING, 1.0, plan=PlanOutcome.FAILED)
    assert machine.now < 0.5


def test_recoveries_run_in_order_and_then_the_goal_is_aborted():
    machine, started = Machine(), []
    machine.cycle(new_goal=True, pose=Pose())
    while finish(machine) is None:
        recovering = machine.state.recovering
        machine.cycle(plan=PlanOutcome.FAILED, recovered=recovering, pose=Pose())
        started += [event.index for event in machine.events if isinstance(event, StartRecovery)]
        assert machine.now < 60.0
    assert started == [0, 1, 2, 3]
    assert finish(machine) == Finish(
        Outcome.ABORTED,
        "Failed to find a valid plan. Even after executing recovery behaviors.",
        Trigger.PLANNING,
    )


def test_a_recovery_drives_until_it_has_ended():
    machine = Machine()
    machine.cycle(new_goal=True, pose=Pose())
    machine.until(lambda m: m.state.recovering, plan=PlanOutcome.FAILED)
    spin = Velocity(turn=0.4)
    machine.cycle(recovery=spin)
    assert machine.command == spin
    machine.cycle(recovered=True)
    assert (machine.state.phase, machine.command) == (Phase.PLANNING, STANDSTILL)


def test_success_after_a_recovery_starts_the_list_over():
    machine = Machine()
    machine.cycle(new_goal=True, pose=Pose())
    machine.until(lambda m: m.state.recovering, plan=PlanOutcome.FAILED)
    machine.cycle(recovered=True)
    assert machine.state.recovery_index == 1
    machine.cycle(plan=PlanOutcome.FOUND)
    assert machine.state.recovery_index == 0


def test_a_robot_that_does_not_get_on_oscillates():
    machine = Machine(replace(LIMITS, oscillation_timeout=10.0, recoveries=0))
    machine.drive()
    machine.until(lambda m: finish(m) is not None, 11.0, control=GO, pose=Pose(0.1, 0.0))
    assert finish(machine).text == "Robot is oscillating. Even after executing recovery behaviors."


def test_a_robot_that_gets_on_does_not_oscillate():
    machine = Machine(replace(LIMITS, oscillation_timeout=10.0))
    machine.drive()
    for i in range(600):
        machine.cycle(control=GO, pose=Pose(0.06 * PERIOD * i * 10))
    assert machine.state.phase is Phase.CONTROLLING


@pytest.mark.parametrize(
    ("position", "rotation", "words"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), "length close to zero"),
        ((0.0, 0.0, 0.0), (0.0, 0.0, float("nan"), 1.0), "nans or infs"),
        ((float("nan"), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), "nans or infs"),
        ((0.0, 0.0, 0.0), (0.7, 0.0, 0.0, 0.7), "z-axis"),
    ],
)
def test_goals_that_are_no_poses_in_the_plane_are_refused(position, rotation, words):
    with pytest.raises(GoalError, match=words):
        check_goal(PoseMessage(Point(*position), Quaternion(*rotation)))


def test_noetic_s_four_recoveries_are_the_default():
    setup = setup_from_parameters({"global_costmap": {"static_map": True}}, "move_base")
    names = ["conservative_reset", "rotate_recovery", "aggressive_reset", "rotate_recovery"]
    assert [recovery.name for recovery in setup.recoveries] == names
    without = setup_from_parameters({"clearing_rotation_allowed": False}, "move_base")
    assert [recovery.name for recovery in without.recoveries] == [
        "conservative_reset",
        "aggressive_reset",
    ]


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"base_local_planner": "eband_local_planner/EBandPlannerROS"}, "not available"),
        (
            {"base_global_planner": "carrot_planner/CarrotPlanner"},
            "there are navfn/NavfnROS, global_planner",
        ),
        ({"recovery_behaviors": [{"name": "x", "type": "y/Z"}]}, "no such type"),
        ({"controller_frequency": 0.0}, "positive"),
    ],
)
def test_wrong_parameters_of_move_base_are_refused(parameters, words):
    with pytest.raises(ParameterError, match=words):
        setup_from_parameters(parameters, "move_base")


def test_names_that_noetic_does_not_know_are_warnings(caplog):
    parameters = {
        "planer_frequency": 1.0,
        "TrajectoryPlannerROS": {"publish_cost_grid": True},
        "local_costmap": {"inflation_radios": 1.0},
    }
    setup_from_parameters(parameters, "published")
    nearest = ["did you mean ~planner_frequency?", "did you mean ~publish_cost_grid_pc?"]
    for words in (*nearest, "~inflation_radios"):
        assert words in caplog.text


@pytest.mark.parametrize(
    ("name", "kind", "namespace", "parameters"),
    [
        ("navfn/NavfnROS", NavfnPlanner, "NavfnROS", {"default_tolerance": 0.5}),
        (
            "global_planner/GlobalPlanner",
            GlobalPlanner,
            "GlobalPlanner",
            {"default_tolerance": 0.5},
        ),
    ],
)
def test_base_global_planner_names_the_global_planner(name, kind, namespace, parameters):
    setup = setup_from_parameters({"base_global_planner": name, namespace: parameters}, "move_base")
    planner = setup.make_global_planner()
    assert type(planner) is kind
    assert (setup.global_planner_name, planner.config.default_tolerance) == (namespace, 0.5)


def test_a_standing_robot_searches_again_at_once_whatever_the_planner_frequency() -> None:
    limits = Limits(planner_frequency=0.5, recoveries=1)
    state, _, _ = advance(State(), Inputs(new_goal=True, pose=Pose()), 0.0, limits)
    state, _, _ = advance(state, Inputs(pose=Pose(), plan=PlanOutcome.FAILED), 1.0, limits)
    assert state.plan_due <= 1.11


@pytest.mark.parametrize("seed", range(50))
def test_a_robot_drives_only_with_a_goal_recent_sensors_and_a_plan(seed: int) -> None:
    """Goals, cancels, sensor faults and searches that end for the newest or an earlier goal, in random order."""
    generator = np.random.default_rng(seed)
    machine = Machine()
    for _ in range(400):
        before = machine.state
        machine.cycle(
            new_goal=generator.random() < 0.1,
            cancel=generator.random() < 0.02,
            current=generator.random() < 0.95,
            plan=generator.choice(list(PlanOutcome), p=[0.7, 0.2, 0.1]),
            searched_goal=max(before.goal - int(generator.integers(3)), 0),
            control=GO if generator.random() < 0.95 else None,
            recovered=generator.random() < 0.3,
            reached=generator.random() < 0.02,
            pose=Pose(),
        )
        assert machine.command != GO or machine.state.phase is Phase.CONTROLLING
        assert machine.state.phase is not Phase.IDLE or machine.command in (None, STANDSTILL)
        if before.phase is Phase.IDLE:
            assert machine.command != GO
        if finish(machine) is not None:
            assert (machine.state, machine.command) == (State(), STANDSTILL)
            assert finish(machine).outcome is not Outcome.SUCCEEDED or not before.follows_earlier
