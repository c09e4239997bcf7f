"""What one source saw lately: costmap_2d's observation buffer."""

from collections import deque

from nav_bundle.core.costmap.layer import Observation


class ObservationBuffer:
    """Observations in the costmap's frame, kept for ``persistence`` [s] after their stamp; with 0, the newest alone."""

    def __init__(self, persistence: float) -> None:
        self.persistence = persistence
        self._kept: deque[tuple[float, Observation]] = deque()

    @property
    def newest(self) -> float:
        """Stamp [s] of the newest observation, minus infinity without one."""
        return self._kept[-1][0] if self._kept else float("-inf")

    @property
    def last(self) -> Observation | None:
        """The newest observation, None without one."""
        return self._kept[-1][1] if self._kept else None

    def add(self, stamp: float, observation: Observation) -> None:
        """Takes an observation newer than those before."""
        if self.persistence <= 0.0:
            self._kept.clear()
        self._kept.append((stamp, observation))

    def current(self, now: float) -> list[Observation]:
        """Returns what counts at ``now`` [s], the oldest first; forgets the rest, but never the newest."""
        while len(self._kept) > 1 and self._kept[0][0] < now - self.persistence:
            self._kept.popleft()
        return [observation for _, observation in self._kept]

    def forget(self) -> None:
        """Drops everything, for a clock that jumped back."""
        self._kept.clear()
