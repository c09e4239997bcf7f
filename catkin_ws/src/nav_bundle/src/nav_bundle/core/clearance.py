"""Room left beside the robot: what it costs to come nearer to obstacles than the plan has to."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.costmap.config import CostmapConfig
from nav_bundle.core.costmap.costmap import Costmap
from nav_bundle.core.costmap.footprint import Footprint
from nav_bundle.core.local_planner import Situation
from nav_bundle.kernels.trajectory import plan_prices

_ASIDE = 0.25
"""The plan comes nearer than it has to where there is more room so far [m] beside it."""
_ASIDES = np.linspace(-_ASIDE, _ASIDE, 7)
"""Where that is looked for."""
_BLUR = 3
"""Cells along the plan in which its narrowest place counts."""


@dataclass
class Clearance:
    """Prices of driving nearer to obstacles than ``distance`` [m]; ``scale`` is that of touching them all the way.

    Nearness counts at the robot's centre, front and rear.
    """

    distance: float = 0.0
    scale: float = 0.0
    _costmap: CostmapConfig | None = None
    _prices: NDArray[np.float64] = field(default_factory=lambda: np.zeros(256), compare=False)

    def prices(self, costmap: Costmap) -> NDArray[np.float64]:
        """Returns the price by the cost of the centre's cell, shape (256,): zero at ``distance``, rising towards it."""
        if self._costmap is not costmap.config:
            self._costmap = costmap.config
            gaps = np.linspace(max(self.distance, 1e-6), 0.0, 50)
            costs = [costmap.cost_at(gap + costmap.footprint.inscribed_radius) for gap in gaps]
            self._prices = self.scale * np.interp(np.arange(256), costs, 1.0 - gaps / gaps[0])
            self._prices[0] = 0.0
        return self._prices

    def ends(self, footprint: Footprint) -> NDArray[np.float64]:
        """Returns where along the robot [m] its nearness to obstacles is looked at: centre, rear and front.

        The middles of circles that cover a long footprint's corners, too, which swing out in turns.
        """
        half, x = footprint.inscribed_radius / 2.0, footprint.vertices[:, 0]
        return np.array([0.0, min(0.0, x.min() + half), max(0.0, x.max() - half)])

    def allowed(self, situation: Situation, plan: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the price that the plan itself cannot avoid, by distance from the robot in cells; shape (n,).

        That is the least across the plan, from ``_ASIDE`` to its right to as far to its left: in a doorway there is no
        other, beside a pillar there is. Empty where nearness costs nothing.
        """
        if self.scale <= 0.0 or self.distance <= 0.0:
            return np.empty(0)
        costmap, pose = situation.costmap, situation.pose
        place, prices = costmap.geometry, self.prices(costmap)
        allowed = np.empty(max(place.rows, place.cols))
        points = np.ascontiguousarray(plan)
        plan_prices(costmap.cells, place.place, prices, points, _ASIDES, _BLUR, pose.x, pose.y, allowed)
        return allowed
