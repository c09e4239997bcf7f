"""Nothing that belongs to a goal outlives it: the same goal begins as if it were the first."""

import numpy as np
import pytest
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import Velocity
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.move_base.config import setup_from_parameters
from nav_bundle.move_base.navigator import Navigator, Sight
from nav_bundle.move_base.state_machine import Outcome, Phase

BODY = [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]]
ROOM = ["##########", *["#........#"] * 4, "##########"]
GOAL = Pose(2.0, 3.0, 3.0)
NEAR = Pose(2.1, 3.0, 0.0)
FAR = Pose(8.0, 3.0, 3.0)
PLANNERS = ["base_local_planner/TrajectoryPlannerROS", "dwa_local_planner/DWAPlannerROS"]


class Robot:
    """A navigator in an empty room, with a robot that is carried about."""

    def __init__(self, planner):
        local = {
            "latch_xy_goal_tolerance": True,
            "xy_goal_tolerance": 0.25,
            "yaw_goal_tolerance": 0.1,
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
        self.now = 100.0

    def costmap(self, config):
        costmap = Costmap(config)
        costmap.set_map(grid_from_text(ROOM, 1.0))
        costmap.update(NEAR, [])
        return costmap

    def begin(self):
        return self.navigator.begin(GOAL, self.pose, self.now)

    def cycle(self):
        self.now += 0.05
        return self.navigator.cycle(Sight(self.pose, self.pose, Pose(), Velocity(), True), self.now)

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


def test_a_new_goal_finds_the_local_planner_as_new(robot):
    robot.begin()
    for _ in range(20):
        robot.cycle()
    assert robot.navigator.phase is Phase.CONTROLLING
    robot.begin()
    assert fields_of(robot.navigator._controller) == fields_of(robot.setup.make_local_planner())
