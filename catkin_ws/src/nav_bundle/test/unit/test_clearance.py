"""The cost of driving close to obstacles, and the part of it that no plan can avoid."""

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL
from nav_bundle.control.clearance import Clearance
from nav_bundle.control.local_planner import Situation
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.cost import INSCRIBED
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation

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
    costmap.update(
        Pose(), [Observation(source, 0.0, 0.0, np.array(points, np.float64).reshape(-1, 2))]
    )
    return Situation(costmap, Pose(), STANDSTILL, Pose())


def test_the_price_rises_from_nothing_at_the_distance_to_all_at_touch():
    costmap = situation((1.0, 0.5)).costmap
    prices = Clearance(0.4, 10.0).prices(costmap)
    at = {
        gap: prices[costmap.cost_at(gap + costmap.footprint.inscribed_radius)]
        for gap in (0.0, 0.2, 0.39, 0.8)
    }
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


@pytest.mark.parametrize("seed", range(20))
def test_the_least_price_across_each_point_of_any_plan_counts_around_its_distance(seed):
    chance = np.random.default_rng(seed)
    there = situation(*chance.uniform(-1.4, 1.4, (12, 2)))
    place, cells = there.costmap.geometry, there.costmap.cells
    clearance = Clearance(0.4, 10.0)
    prices = clearance.prices(there.costmap)
    plan = np.column_stack([*np.cumsum(chance.normal(0.0, 0.05, (2, 61)), axis=1), np.zeros(61)])

    def cost(x, y):
        row, col = place.row_of(y), place.col_of(x)
        return (
            int(cells[row, col]) if 0 <= row < place.rows and 0 <= col < place.cols else INSCRIBED
        )

    points = plan[::2, :2]
    expected = np.zeros(max(cells.shape))
    for index, point in enumerate(points):
        along = points[min(index + 2, len(points) - 1)] - points[max(index - 2, 0)]
        across = np.array([-along[1], along[0]]) / np.hypot(*along)
        away = int(np.hypot(*point) / place.resolution)
        if cost(*point) < INSCRIBED and away < len(expected):
            least = min(
                prices[cost(*(point + aside * across))] for aside in np.linspace(-0.25, 0.25, 7)
            )
            around = expected[max(away - 3, 0) : away + 4]
            np.maximum(around, least, out=around)
    assert clearance.allowed(there, plan) == pytest.approx(expected)
