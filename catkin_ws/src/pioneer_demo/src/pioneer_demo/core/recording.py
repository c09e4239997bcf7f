"""What a film of the fleet shows: where each robot was, what its laser met, and where it planned to go."""

import bisect
import collections
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pioneer_fleet.core.geometry import Points, Pose

INTERVAL = 0.1
"""Simulated seconds between two poses, and two scans, that are kept of a robot."""

Hits = NDArray[np.float32]
"""Where beams ended, shape (n, 2), in the robot's frame [m]."""

NOTHING: Hits = np.empty((0, 2), np.float32)


Kept = TypeVar("Kept")


class Recording:
    """Poses in ``map`` and scans of all robots, by simulated time [s]."""

    def __init__(self) -> None:
        self._poses: dict[str, list[tuple[float, Pose]]] = collections.defaultdict(list)
        self._scans: dict[str, list[tuple[float, Hits]]] = collections.defaultdict(list)
        self._plans: dict[str, list[tuple[float, Points]]] = collections.defaultdict(list)

    def add_pose(self, name: str, stamp: float, pose: Pose) -> None:
        """Notes where a robot is; what comes too soon after the one before, or late, is left out."""
        kept = self._poses[name]
        if not kept or stamp >= kept[-1][0] + INTERVAL - 1e-6:
            kept.append((stamp, pose))

    def add_scan(self, name: str, stamp: float, hits: Hits) -> None:
        """Notes what a robot's laser has met, as `add_pose` does."""
        kept = self._scans[name]
        if not kept or stamp >= kept[-1][0] + INTERVAL - 1e-6:
            kept.append((stamp, hits))

    def add_plan(self, name: str, stamp: float, points: Points) -> None:
        """Notes a robot's plan, which holds until its next."""
        self._plans[name].append((stamp, points))

    def times(self, rate: float) -> NDArray[np.float64]:
        """Returns the times of ``rate`` pictures a simulated second, from the first pose to the last; none without."""
        stamps = [stamp for kept in self._poses.values() for stamp, _ in (kept[0], kept[-1])]
        return np.arange(min(stamps), max(stamps) + 0.5 / rate, 1.0 / rate) if stamps else np.empty(0)

    def pose(self, name: str, time: float) -> Pose | None:
        """Returns where a robot is at ``time``, straight between two poses; None before the first."""
        kept = self._poses.get(name, [])
        after = bisect.bisect_right(kept, time, key=lambda one: one[0])
        if after == 0:
            return None
        if after == len(kept):
            return kept[-1][1]
        (a, before), (b, following) = kept[after - 1], kept[after]
        return before.between(following, (time - a) / (b - a))

    def scan(self, name: str, time: float) -> tuple[float, Hits]:
        """Returns the stamp of the newest scan at ``time`` and what it met; nothing before the first."""
        return _newest(self._scans.get(name, []), time) or (time, NOTHING)

    def plan(self, name: str, time: float) -> Points:
        """Returns a robot's plan at ``time``; empty before the first."""
        return (_newest(self._plans.get(name, []), time) or (time, []))[1]


def _newest(kept: list[tuple[float, Kept]], time: float) -> tuple[float, Kept] | None:
    after = bisect.bisect_right(kept, time, key=lambda one: one[0])
    return kept[after - 1] if after else None
