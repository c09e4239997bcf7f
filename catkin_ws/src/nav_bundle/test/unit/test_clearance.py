"""What nearness to obstacles costs, and what of it the plan cannot avoid."""

import numpy as np
import pytest

from nav_bundle.core.clearance import Clearance
from nav_bundle.core.costmap.config import costmap_config_from_parameters
from nav_bundle.core.costmap.costmap import Costmap
from nav_bundle.core.costmap.layer import Observation
from nav_bundle.core.local_planner import STANDSTILL, Situation
from nav_bundle.core.pose import Pose

PARAMETERS = {
    "rolling_window": True,
    "width": 3.0,
    "height": 3.0,
    "inflation_radius": 2.0,
    "cost_scaling_factor": 5.0,
    "footprint": [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]],
    "observation_sources": "laser",
    "laser": {"topic": "base_scan", "marking": True},
}
STRAIGHT = np.column_stack([np.arange(0.0, 1.4, 0.025), np.zeros(56), np.zeros(56)])


def situation(*points):
    costmap = Costmap(costmap_config_from_parameters(PARAMETERS, "test"))
    source = costmap.config.layers[0].sources[0]
    costmap.update(Pose(), [Observation(source, 0.0, 0.0, np.array(points, np.float64).reshape(-1, 2))])
    return Situation(costmap, Pose(), STANDSTILL, Pose())


def test_the_price_rises_from_nothing_at_the_distance_to_all_at_touch():
    costmap = situation((1.0, 0.5)).costmap
    prices = Clearance(0.4, 10.0).prices(costmap)
    at = {gap: prices[costmap.cost_at(gap + costmap.footprint.inscribed_radius)] for gap in (0.0, 0.2, 0.39, 0.8)}
    assert at[0.0] == 10.0
    assert at[0.2] == pytest.approx(5.0, abs=1.5)
    assert at[0.39] == pytest.approx(0.0, abs=1.5)
    assert at[0.8] == prices[0] == 0.0


def test_in_a_doorway_the_price_that_all_ways_have_is_free():
    door = [(0.8, y) for y in np.arange(-1.4, 1.4, 0.05) if abs(y) > 0.35]
    allowed = Clearance(0.4, 10.0).allowed(situation(*door), STRAIGHT)
    assert allowed[16] > 4.0
    assert allowed[2] == 0.0


def test_beside_a_pillar_no_nearness_is_free():
    assert Clearance(0.4, 10.0).allowed(situation((0.8, 0.4)), STRAIGHT).max() < 1.0


def test_where_nearness_costs_nothing_nothing_is_worked_out():
    assert len(Clearance(0.4, 0.0).allowed(situation((0.8, 0.4)), STRAIGHT)) == 0
