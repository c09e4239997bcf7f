"""What is specific to DWAPlannerROS: its parameters, its velocity samples, and each of its critics."""

import math

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.control.clearance import Clearance
from nav_bundle.control.dwa_config import dwa_config_from_parameters
from nav_bundle.control.dwa_planner import DwaPlanner, DynamicWindow, Oscillation
from nav_bundle.control.dynamic_window_kernel import Nose
from nav_bundle.control.local_planner import Situation
from nav_bundle.control.trajectory_kernel import Horizon, Scales
from nav_bundle.control.trajectory_planner import TrajectoryPlanner
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.move_base.config import setup_from_parameters
from pioneer_node.core.parameter import ParameterError

LOCAL = {
    "rolling_window": True,
    "width": 4.0,
    "height": 4.0,
    "robot_radius": 0.2,
    "inflation_radius": 0.0,
}
AHEAD = np.ascontiguousarray(np.linspace((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), 60))


def config_of(**parameters):
    return dwa_config_from_parameters(parameters, "DWAPlannerROS", 20.0)


def situation(velocity=STANDSTILL, yaw=0.0):
    costmap = Costmap(costmap_config_from_parameters(LOCAL, "local"))
    costmap.update(Pose(), [])
    return Situation(costmap, Pose(0.0, 0.0, yaw), velocity, Pose())


def chosen(velocity=STANDSTILL, yaw=0.0, plan=AHEAD, **parameters):
    planner = DwaPlanner(config_of(max_vel_y=0.0, min_vel_y=0.0, **parameters), 0.05)
    planner.set_plan(plan)
    return planner.decide(situation(velocity, yaw)).velocity


def nose_of(alignment, front, twirling):
    return Nose(0.3, np.empty((0, 0), np.int32), alignment, front, twirling)


def costs_of(samples, scales, nose, yaw=0.0, aligned=True):
    window = DynamicWindow(
        Velocity(9.0, 9.0, 9.0), Horizon(1.0, 0.025, 0.1), scales, Clearance(), nose, False
    )
    assert window.begin_window(situation(yaw=yaw), AHEAD, aligned)
    return [scored.cost for scored in window.all_of(np.array(samples, np.float64))]


def test_without_parameters_it_has_noetics_defaults():
    config = config_of()
    assert (config.vx_samples, config.vy_samples, config.vth_samples) == (3, 10, 20)
    assert (config.path_distance_bias, config.goal_distance_bias, config.occdist_scale) == (
        0.6,
        0.8,
        0.01,
    )
    assert (config.min_vel_trans, config.min_vel_theta, config.forward_point_distance) == (
        0.1,
        0.4,
        0.325,
    )


def test_former_parameter_names_are_understood():
    config = config_of(max_trans_vel=0.7, min_rot_vel=0.3, rot_stopped_vel=0.05)
    assert (config.max_vel_trans, config.min_vel_theta, config.theta_stopped_vel) == (
        0.7,
        0.3,
        0.05,
    )


@pytest.mark.parametrize(
    "wrong",
    [{"sim_time": 0.0}, {"min_vel_x": 2.0}],
)
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ParameterError):
        config_of(**wrong)


@pytest.mark.parametrize(
    ("name", "kind", "namespace"),
    [
        ("dwa_local_planner/DWAPlannerROS", DwaPlanner, "DWAPlannerROS"),
        ("DWAPlannerROS", DwaPlanner, "DWAPlannerROS"),
        ("base_local_planner/TrajectoryPlannerROS", TrajectoryPlanner, "TrajectoryPlannerROS"),
    ],
)
def test_base_local_planner_names_it(name, kind, namespace):
    setup = setup_from_parameters(
        {"base_local_planner": name, namespace: {"max_vel_x": 0.3}}, "move_base"
    )
    assert isinstance(setup.make_local_planner(), kind)
    assert (setup.local_planner_name, setup.local_planner.max_vel_x) == (namespace, 0.3)


def test_another_local_planner_is_refused_with_those_there_are():
    with pytest.raises(ParameterError, match=r"teb.*there are.*DWAPlannerROS"):
        setup_from_parameters(
            {"base_local_planner": "teb_local_planner/TebLocalPlannerROS"}, "move_base"
        )


def test_it_drives_no_faster_than_it_can_get_within_a_cycle():
    assert chosen(Velocity(0.2)).x == pytest.approx(0.2 + 2.5 * 0.05)
    assert chosen(Velocity(0.54)).x <= 0.55


def test_it_turns_to_a_plan_beside_it_no_slower_than_min_vel_theta():
    velocity = chosen(yaw=1.7)
    assert velocity.turn <= -0.4


def test_it_never_stands_still_before_the_goal():
    generator = np.random.default_rng(6)
    for _ in range(30):
        velocity = chosen(
            Velocity(float(generator.uniform(0.0, 0.5))), yaw=float(generator.uniform(-3.0, 3.0))
        )
        assert math.hypot(velocity.x, velocity.y) >= 0.1 - 1e-9 or abs(velocity.turn) >= 0.4 - 1e-9


def test_the_nose_keeps_to_the_plan():
    nothing = Scales(0.0, 0.0, 0.0)
    straight, curved = costs_of([[0.3, 0.0, 0.0], [0.3, 0.0, 0.9]], nothing, nose_of(1.0, 0.0, 0.0))
    assert straight == 0.0
    assert curved > 2.0
    assert costs_of([[0.3, 0.0, 0.9]], nothing, nose_of(1.0, 0.0, 0.0), aligned=False) == [0.0]


def test_the_nose_is_drawn_beyond_the_goal():
    turns = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]
    towards, away = costs_of(turns, Scales(0.0, 0.0, 0.0), nose_of(0.0, 1.0, 0.0), yaw=1.2)
    assert towards < away


def test_twirling_costs_by_the_turning_speed():
    costs = costs_of(
        [[0.3, 0.0, -0.5], [0.3, 0.0, 0.25]], Scales(0.0, 0.0, 0.0), nose_of(0.0, 0.0, 2.0)
    )
    assert costs == pytest.approx([1.0, 0.5])


def test_a_reversal_closes_the_way_back_until_the_robot_has_moved():
    oscillation = Oscillation(0.1, 0.05, 0.2)
    ways = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5], [0.3, 0.0, 0.5]])
    oscillation.note(Velocity(turn=0.5), Pose())
    assert oscillation.allowed(ways).all()
    oscillation.note(Velocity(turn=-0.5), Pose(0.0, 0.0, 0.1))
    assert oscillation.allowed(ways).tolist() == [False, True, False]
    oscillation.note(Velocity(turn=-0.5), Pose(0.0, 0.0, -0.15))
    assert oscillation.allowed(ways).all()


def test_turns_while_driving_are_no_reversals():
    oscillation = Oscillation(0.1, 0.05, 0.2)
    for turn in (0.5, -0.5, 0.5):
        oscillation.note(Velocity(0.3, 0.0, turn), Pose())
    assert oscillation.allowed(np.array([[0.3, 0.0, -0.5], [-0.3, 0.0, 0.0]])).all()
