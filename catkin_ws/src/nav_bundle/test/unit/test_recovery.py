"""Recovery behaviours: which part of a costmap is cleared, and how the robot rotates."""

import math

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.cost import LETHAL
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.move_base.recovery import (
    _MAKERS,
    BackUp,
    ClearConfig,
    ClearCostmapRecovery,
    MoveSlowAndClear,
    RotateConfig,
    RotateRecovery,
    SlowConfig,
    Surroundings,
    recoveries_from_parameters,
)

PARAMETERS = {
    "rolling_window": True,
    "width": 6.0,
    "height": 6.0,
    "inflation_radius": 0.0,
    "footprint": [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]],
    "observation_sources": "laser",
    "laser": {"topic": "base_scan"},
}


def costmap_with(*points):
    costmap = Costmap(costmap_config_from_parameters(PARAMETERS, "test"))
    source = costmap.config.layers[0].sources[0]
    costmap.update(
        Pose(), [Observation(source, 0.0, 0.0, np.array(points, np.float64).reshape(-1, 2))]
    )
    return costmap


def around(costmap, pose=None, now=0.0):
    return Surroundings(costmap, pose or Pose(), costmap, pose or Pose(), now)


def test_clearing_forgets_what_lies_beyond_half_the_reset_distance():
    costmap = costmap_with((0.9, 0.0), (1.9, 0.0))
    assert (costmap.cells == LETHAL).sum() == 2
    assert (
        ClearCostmapRecovery("reset", ClearConfig(reset_distance=3.0)).step(around(costmap)) is None
    )
    costmap.update(Pose(), [])
    assert (costmap.cells == LETHAL).sum() == 1


@pytest.mark.parametrize("tolerance", [0.1, 0.5])
@pytest.mark.parametrize("begun", [0.0, 2.0, -3.0])
def test_the_robot_turns_once_round_to_the_left(begun, tolerance):
    costmap, recovery = (
        costmap_with(),
        RotateRecovery("rotate", RotateConfig(yaw_goal_tolerance=tolerance)),
    )
    recovery.start()
    yaw = begun
    for _ in range(1000):
        velocity = recovery.step(around(costmap, Pose(0.0, 0.0, math.remainder(yaw, math.tau))))
        if velocity is None:
            break
        assert 0.4 <= velocity.turn <= 1.0
        assert velocity.x == 0.0
        yaw += velocity.turn * 0.05
    assert yaw - begun == pytest.approx(math.tau, abs=0.6)


def test_no_turn_is_made_where_headings_do_not_matter():
    recovery = RotateRecovery("rotate", RotateConfig(yaw_goal_tolerance=3.15))
    recovery.start()
    assert recovery.step(around(costmap_with())) is None
    assert recovery.complaint == ""


def test_the_turn_ends_in_front_of_an_obstacle():
    recovery = RotateRecovery("rotate", RotateConfig())
    recovery.start()
    assert recovery.step(around(costmap_with((0.0, 0.3)))) is None
    assert "collision" in recovery.complaint


BEHAVIOURS = {
    "clear": lambda: ClearCostmapRecovery("reset", ClearConfig()),
    "rotate": lambda: RotateRecovery("rotate", RotateConfig()),
    "rotate slowly": lambda: RotateRecovery(
        "rotate", RotateConfig(min_in_place_rotational_vel=0.0)
    ),
    "clear inside": lambda: ClearCostmapRecovery("reset", ClearConfig(invert_area_to_clear=True)),
    "slow": lambda: MoveSlowAndClear("slow", SlowConfig()),
    "back up": lambda: BackUp(RotateRecovery("rotate", RotateConfig())),
}


@pytest.mark.parametrize("kind", BEHAVIOURS)
def test_every_recovery_ends_although_the_robot_does_not_move_and_says_so(kind):
    costmap, recovery = costmap_with(), BEHAVIOURS[kind]()
    for _ in range(2):
        recovery.start()
        now = 100.0
        while recovery.step(around(costmap, now=now)) is not None:
            now += 0.5
            assert now < 400.0
        assert kind in ("clear", "clear inside", "slow") or "has not" in recovery.complaint


def test_every_type_of_recovery_is_among_those_that_are_seen_to_end():
    seen = {type(make()).__name__ for make in BEHAVIOURS.values()}
    assert seen == {*_MAKERS, "BackUp"}


def test_a_robot_that_backs_up_as_commanded_is_not_reported():
    costmap, recovery = costmap_with(), BackUp(ClearCostmapRecovery("reset", ClearConfig()))
    recovery.start()
    now, x = 0.0, 0.0
    while (velocity := recovery.step(around(costmap, Pose(x), now))) is not None:
        now += 0.05
        x += velocity.x * 0.05
    assert -0.4 < x < -0.3
    assert recovery.complaint == ""


def test_inverted_clearing_forgets_what_lies_within_half_the_reset_distance():
    costmap = costmap_with((0.9, 0.0), (1.9, 0.0))
    config = ClearConfig(reset_distance=3.0, invert_area_to_clear=True)
    ClearCostmapRecovery("reset", config).step(around(costmap))
    costmap.update(Pose(), [])
    (cell,) = np.argwhere(costmap.cells == LETHAL)
    assert cell[1] == costmap.geometry.col_of(1.9)


@pytest.mark.parametrize(("names", "left"), [(["obstacle_layer"], 1), (["other"], 2), ((), 1)])
def test_clearing_is_limited_to_the_named_layers(names, left):
    costmap = costmap_with((0.9, 0.0), (1.9, 0.0))
    config = ClearConfig(reset_distance=3.0, layer_names=names)
    ClearCostmapRecovery("reset", config).step(around(costmap))
    costmap.update(Pose(), [])
    assert (costmap.cells == LETHAL).sum() == left


def test_move_slow_and_clear_is_read_from_move_base_s_parameters():
    parameters = {
        "recovery_behaviors": [{"name": "slow", "type": "move_slow_and_clear/MoveSlowAndClear"}],
        "slow": {"clearing_distance": 1.0, "limited_trans_speed": 0.1, "limited_rot_speed": 0.2},
    }
    (recovery,) = recoveries_from_parameters(parameters, 0.3)
    costmap = costmap_with((0.9, 0.0), (1.9, 0.0))
    assert recovery.step(around(costmap)) is None
    costmap.update(Pose(), [])
    assert (costmap.cells == LETHAL).sum() == 1
    assert (recovery.limit.speed, recovery.limit.turn, recovery.limit.distance) == (0.1, 0.2, 0.3)
