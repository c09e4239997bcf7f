"""Recorded data for a video of the fleet: each robot's poses, scans and plans."""

import bisect
import collections
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pioneer_fleet.geometry import Points, Pose, pose_at

INTERVAL = 0.1
"""Minimum time between two recorded poses, or scans, of a robot [s of simulated time]."""

Hits = NDArray[np.float32]
"""End points of beams in the robot's frame [m], shape (n, 2)."""

NOTHING: Hits = np.empty((0, 2), np.float32)

Kept = TypeVar("Kept")


class Recording:
    """Poses in ``map``, scans and plans of all robots, by simulated time [s]."""

    def __init__(self) -> None:
        self._poses: dict[str, list[tuple[float, Pose]]] = collections.defaultdict(list)
        self._scans: dict[str, list[tuple[float, Hits]]] = collections.defaultdict(list)
        self._plans: dict[str, list[tuple[float, Points]]] = collections.defaultdict(list)

    def add_pose(self, name: str, stamp: float, pose: Pose) -> None:
        """Records a robot's pose, unless it is out of order or less than `INTERVAL` after the previous one."""
        _append(self._poses[name], stamp, pose)

    def add_scan(self, name: str, stamp: float, hits: Hits) -> None:
        """Records a robot's scan, under the same condition as `add_pose`."""
        _append(self._scans[name], stamp, hits)

    def add_plan(self, name: str, stamp: float, points: Points) -> None:
        """Records a robot's plan, valid until its next one."""
        self._plans[name].append((stamp, points))

    def times(self, rate: float) -> NDArray[np.float64]:
        """Returns the times of ``rate`` frames per simulated second, from first to last pose; empty without poses."""
        stamps = [stamp for kept in self._poses.values() for stamp, _ in (kept[0], kept[-1])]
        return (
            np.arange(min(stamps), max(stamps) + 0.5 / rate, 1.0 / rate) if stamps else np.empty(0)
        )

    def pose(self, name: str, time: float) -> Pose | None:
        """Returns a robot's pose at ``time``, linearly interpolated; None before the first pose."""
        return pose_at(self._poses.get(name, []), time)

    def scan(self, name: str, time: float) -> tuple[float, Hits]:
        """Returns stamp and end points of the newest scan at ``time``; no points before the first scan."""
        return _newest(self._scans.get(name, []), time) or (time, NOTHING)

    def plan(self, name: str, time: float) -> Points:
        """Returns a robot's plan at ``time``; empty before the first."""
        return (_newest(self._plans.get(name, []), time) or (time, []))[1]


def _append(kept: list[tuple[float, Kept]], stamp: float, value: Kept) -> None:
    if not kept or stamp >= kept[-1][0] + INTERVAL - 1e-6:
        kept.append((stamp, value))


def _newest(kept: list[tuple[float, Kept]], time: float) -> tuple[float, Kept] | None:
    after = bisect.bisect_right(kept, time, key=lambda one: one[0])
    return kept[after - 1] if after else None
