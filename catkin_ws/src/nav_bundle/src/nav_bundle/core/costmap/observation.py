"""Recent observations of one source, as in costmap_2d's observation buffer."""

from collections import deque

from nav_bundle.core.costmap.layer import Observation


class ObservationBuffer:
    """Observations in the costmap's frame, kept for ``persistence`` [s] after their stamp; 0 keeps only the newest."""

    def __init__(self, persistence: float) -> None:
        self.persistence = persistence
        self._kept: deque[tuple[float, Observation]] = deque()

    @property
    def newest(self) -> float:
        """Stamp [s] of the newest observation; minus infinity if there is none."""
        return self._kept[-1][0] if self._kept else float("-inf")

    @property
    def last(self) -> Observation | None:
        """The newest observation; None if there is none."""
        return self._kept[-1][1] if self._kept else None

    def add(self, stamp: float, observation: Observation) -> None:
        """Adds an observation, which must be newer than the earlier ones."""
        if self.persistence <= 0.0:
            self._kept.clear()
        self._kept.append((stamp, observation))

    def current(self, now: float) -> list[Observation]:
        """Returns the observations valid at ``now`` [s], oldest first; drops expired ones, but never the newest."""
        while len(self._kept) > 1 and self._kept[0][0] < now - self.persistence:
            self._kept.popleft()
        return [observation for _, observation in self._kept]

    def forget(self) -> None:
        """Drops all observations, for example after a clock jump."""
        self._kept.clear()
