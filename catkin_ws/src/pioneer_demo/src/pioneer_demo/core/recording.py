"""What a film of the fleet shows: where each robot was, and what its laser met."""

import bisect
import collections

import numpy as np
from numpy.typing import NDArray

from pioneer_demo.core.geometry import Pose

INTERVAL = 0.1
"""Simulated seconds between two poses, and two scans, that are kept of a robot."""

Hits = NDArray[np.float32]
"""Where beams ended, shape (n, 2), in the robot's frame [m]."""

NOTHING: Hits = np.empty((0, 2), np.float32)


class Recording:
    """Poses in ``map`` and scans of all robots, by simulated time [s]."""

    def __init__(self) -> None:
        self._poses: dict[str, list[tuple[float, Pose]]] = collections.defaultdict(list)
        self._scans: dict[str, list[tuple[float, Hits]]] = collections.defaultdict(list)

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
        kept = self._scans.get(name, [])
        after = bisect.bisect_right(kept, time, key=lambda one: one[0])
        return kept[after - 1] if after else (time, NOTHING)
