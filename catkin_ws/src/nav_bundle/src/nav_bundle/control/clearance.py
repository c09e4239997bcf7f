"""Clearance cost: penalises driving closer to obstacles than the plan requires."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.control.local_planner import Situation
from nav_bundle.control.trajectory_kernel import plan_prices
from nav_bundle.costmap.config import CostmapConfig
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.footprint import Footprint

_ASIDE = 0.25
"""Lateral search range [m]: more clearance within this distance beside the plan counts as avoidable nearness."""
_ASIDES = np.linspace(-_ASIDE, _ASIDE, 7)
"""Lateral offsets [m] that are searched."""
_BLUR = 3
"""Window along the plan [cells] in which the narrowest place counts."""


@dataclass
class Clearance:
    """Penalty for driving closer to obstacles than ``distance`` [m].

    ``scale`` is the penalty for touching obstacles all the way. Clearance is measured at the robot's centre, front
    and rear.
    """

    distance: float = 0.0
    scale: float = 0.0
    _costmap: CostmapConfig | None = None
    _prices: NDArray[np.float64] = field(default_factory=lambda: np.zeros(256), compare=False)

    def prices(self, costmap: Costmap) -> NDArray[np.float64]:
        """Returns the penalty for each cell cost, shape (256,): zero at ``distance``, rising towards the obstacle."""
        if self._costmap is not costmap.config:
            self._costmap = costmap.config
            gaps = np.linspace(max(self.distance, 1e-6), 0.0, 50)
            costs = [costmap.cost_at(gap + costmap.footprint.inscribed_radius) for gap in gaps]
            self._prices = self.scale * np.interp(np.arange(256), costs, 1.0 - gaps / gaps[0])
            self._prices[0] = 0.0
        return self._prices

    def ends(self, footprint: Footprint) -> NDArray[np.float64]:
        """Returns the positions along the robot's x axis [m] where clearance is measured: centre, rear and front.

        They are the centres of circles that also cover the corners of a long footprint, which swing out in turns.
        """
        half, x = footprint.inscribed_radius / 2.0, footprint.vertices[:, 0]
        return np.array([0.0, min(0.0, x.min() + half), max(0.0, x.max() - half)])

    def allowed(self, situation: Situation, plan: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the penalty that the plan cannot avoid, by distance from the robot in cells; shape (n,).

        This is the smallest penalty across the plan, from ``_ASIDE`` on its right to ``_ASIDE`` on its left: a doorway
        leaves no alternative, a pillar does. Empty if clearance has no cost.
        """
        if self.scale <= 0.0 or self.distance <= 0.0:
            return np.empty(0)
        costmap, pose = situation.costmap, situation.pose
        place, prices = costmap.geometry, self.prices(costmap)
        allowed = np.empty(max(place.rows, place.cols))
        points = np.ascontiguousarray(plan)
        plan_prices(
            costmap.cells, place.place, prices, points, _ASIDES, _BLUR, pose.x, pose.y, allowed
        )
        return allowed
