"""Recovery behaviours: which part of a costmap is cleared, and how the robot rotates."""

import math

import numpy as np
import pytest

from nav_bundle.core.costmap.config import costmap_config_from_parameters
from nav_bundle.core.costmap.cost import LETHAL
from nav_bundle.core.costmap.costmap import Costmap
from nav_bundle.core.costmap.layer import Observation
from nav_bundle.core.pose import Pose
from nav_bundle.core.recovery import ClearConfig, ClearCostmapRecovery, RotateConfig, RotateRecovery, Surroundings

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
    costmap.update(Pose(), [Observation(source, 0.0, 0.0, np.array(points, np.float64).reshape(-1, 2))])
    return costmap


def around(costmap, pose=None):
    return Surroundings(costmap, pose or Pose(), costmap, pose or Pose())


def test_clearing_forgets_what_lies_beyond_half_the_reset_distance():
    costmap = costmap_with((0.9, 0.0), (1.9, 0.0))
    assert (costmap.cells == LETHAL).sum() == 2
    assert ClearCostmapRecovery("reset", ClearConfig(reset_distance=3.0)).step(around(costmap)) is None
    costmap.update(Pose(), [])
    assert (costmap.cells == LETHAL).sum() == 1


@pytest.mark.parametrize("tolerance", [0.1, 0.5])
@pytest.mark.parametrize("begun", [0.0, 2.0, -3.0])
def test_the_robot_turns_once_round_to_the_left(begun, tolerance):
    costmap, recovery = costmap_with(), RotateRecovery("rotate", RotateConfig(yaw_goal_tolerance=tolerance))
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
