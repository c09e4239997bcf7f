"""Nothing that belongs to a goal outlives it: the same goal begins as if it were the first."""

import numpy as np
import pytest
from drawn_room import enlarged

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.move_base import navigator
from nav_bundle.move_base.config import setup_from_parameters
from nav_bundle.move_base.navigator import Cycle, Navigator, Sight
from nav_bundle.move_base.recovery import MoveSlowAndClear, SlowConfig
from nav_bundle.move_base.state_machine import Outcome, Phase

BODY = [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]]
ROOM = ["##########", *["#........#"] * 4, "##########"]
GOAL = Pose(2.0, 3.0, 3.0)
NEAR = Pose(2.1, 3.0, 0.0)
FAR = Pose(8.0, 3.0, 3.0)
PLANNERS = ["base_local_planner/TrajectoryPlannerROS", "dwa_local_planner/DWAPlannerROS"]


class Robot:
    """A navigator in an empty room, with a robot that is carried about."""

    def __init__(self, planner, **options):
        self.planner = planner
        local = {
            "latch_xy_goal_tolerance": True,
            "xy_goal_tolerance": 0.25,
            "yaw_goal_tolerance": 0.1,
            **options,
        }
        shared = {"footprint": BODY, "inflation_radius": 0.3}
        parameters = {
            "base_local_planner": planner,
            planner.split("/")[1]: local,
            "global_costmap": {**shared, "static_map": True},
            "local_costmap": {**shared, "static_map": True, "global_frame": "map"},
        }
        self.setup = setup_from_parameters(parameters, "test")
        config = self.setup.global_costmap, self.setup.local_costmap
        self.costmaps = [self.costmap(each) for each in config]
        self.navigator = Navigator(self.setup, *self.costmaps, lambda: None)
        self.pose = NEAR
        self.goal = GOAL
        self.now = 100.0

    def costmap(self, config):
        costmap = Costmap(config)
        costmap.set_map(enlarged(ROOM, 20))
        costmap.update(NEAR, [])
        return costmap

    def begin(self):
        return self.navigator.begin(self.goal, self.pose, self.now)

    def cycle(self, velocity=STANDSTILL):
        self.now += 0.05
        return self.navigator.cycle(Sight(self.pose, self.pose, Pose(), velocity, True), self.now)

    def until(self, condition):
        for _ in range(100):
            cycle = self.cycle()
            if condition(cycle):
                return cycle
        raise AssertionError("not within 100 cycles")


@pytest.fixture(params=PLANNERS)
def robot(request):
    return Robot(request.param)


def fields_of(value):
    """Returns what an object remembers, nested objects of the package included."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if type(value).__module__.startswith("nav_bundle.") and hasattr(value, "__dict__"):
        return {name: fields_of(each) for name, each in vars(value).items()}
    return value


@pytest.mark.parametrize("end", ["cancelled", "replaced"])
def test_a_goal_that_was_ended_near_it_is_not_reached_from_afar(robot, end):
    robot.begin()
    robot.until(lambda cycle: cycle.decision is not None)
    if end == "cancelled":
        assert robot.navigator.cancel(robot.now).finish.outcome is Outcome.PREEMPTED
    robot.pose = FAR
    robot.begin()
    cycle = robot.until(lambda cycle: cycle.decision is not None)
    assert not cycle.decision.reached
    assert cycle.finish is None


def test_a_new_goal_s_plan_finds_the_local_planner_as_new(robot):
    robot.begin()
    for _ in range(20):
        robot.cycle()
    assert robot.navigator.phase is Phase.CONTROLLING
    robot.begin()
    cycle = robot.until(lambda cycle: cycle.plan is not None)
    fresh = robot.setup.make_local_planner()
    fresh.set_plan(cycle.plan)
    assert fields_of(robot.navigator._controller) == fields_of(fresh)


def test_a_restarted_goal_finds_the_local_planner_as_new(robot):
    robot.begin()
    for _ in range(20):
        robot.cycle()
    assert robot.navigator.restart(robot.pose, robot.now).command == STANDSTILL
    assert fields_of(robot.navigator._controller) == fields_of(robot.setup.make_local_planner())


def way_in(robot, goal_period):
    """Returns how far [m] the robot drives in 8 s if its goal is sent again every ``goal_period`` [s]."""
    robot.pose = start = Pose(1.5, 3.0, 0.0)
    robot.goal = Pose(8.0, 3.0, 0.0)
    velocity = Velocity()
    robot.begin()
    due = robot.now + goal_period
    for _ in range(160):
        if robot.now >= due:
            due += goal_period
            begun = robot.begin()
            velocity = begun.command or velocity
        velocity = robot.cycle(velocity).command or velocity
        robot.pose = robot.pose.compose(Pose(0.05 * velocity.x, 0.0, 0.05 * velocity.turn))
    return robot.pose.distance(start)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 20.0])
def test_the_same_goal_again_and_again_does_not_slow_the_robot(robot, frequency):
    alone = way_in(robot, 1000.0)
    again = way_in(Robot(robot.planner), 1.0 / frequency)
    assert again > 0.95 * alone > 1.0


def test_goals_that_arrive_faster_than_searches_end_do_not_slow_the_robot(robot, monkeypatch):
    alone = way_in(robot, 1000.0)
    monkeypatch.setattr(navigator, "_CELLS_DRIVING", 300)
    another = Robot(robot.planner)
    assert way_in(another, 0.05) > 0.95 * alone
    assert another.navigator._state.follows_earlier, "the searches were not slow"


def test_a_recovery_s_speed_limit_holds_until_the_robot_has_left_the_place(robot):
    recovery = MoveSlowAndClear("slow", SlowConfig(limited_trans_speed=0.1, limited_distance=0.3))
    robot.pose = start = Pose(1.5, 3.0, 0.0)
    robot.goal = Pose(8.0, 3.0, 0.0)
    robot.begin()
    robot.navigator._recovery = recovery
    robot.navigator._end_recovery(Cycle())
    velocity, limited = STANDSTILL, True
    for _ in range(160):
        velocity = robot.cycle(velocity).command or velocity
        limited = limited and robot.pose.distance(start) <= 0.3
        assert not limited or velocity.x <= 0.1
        robot.pose = robot.pose.compose(Pose(0.05 * velocity.x, 0.0, 0.05 * velocity.turn))
    assert not limited
    assert velocity.x > 0.4


@pytest.mark.parametrize("holonomic", [True, False])
def test_a_holonomic_robot_drives_to_a_goal_beside_it_without_turning(holonomic):
    options = {"holonomic_robot": holonomic}
    robot = Robot("base_local_planner/TrajectoryPlannerROS", **options)
    robot.pose, robot.goal = Pose(4.0, 1.5, 0.0), Pose(4.0, 3.5, 0.0)
    robot.begin()
    velocity, turned, strafed, outcome = STANDSTILL, 0.0, 0.0, None
    for _ in range(600):
        cycle = robot.cycle(velocity)
        velocity = cycle.command or velocity
        step = Pose(0.05 * velocity.x, 0.05 * velocity.y, 0.05 * velocity.turn)
        robot.pose = robot.pose.compose(step)
        turned += abs(step.yaw)
        strafed += abs(step.y)
        if cycle.finish is not None:
            outcome = cycle.finish.outcome
            break
    assert outcome is Outcome.SUCCEEDED
    assert (turned < 0.5, strafed > 1.0) == (holonomic, holonomic)
