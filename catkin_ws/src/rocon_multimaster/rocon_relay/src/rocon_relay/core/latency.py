"""How long the way to another gateway takes."""

import statistics
from collections import deque
from dataclasses import dataclass

SAMPLES = 5
"""So many round trips are kept for each gateway, as rocon keeps them."""


@dataclass(frozen=True, slots=True)
class Latency:
    """Round trips between two relays, the newest few; what waits on the link before the answer included [s]."""

    shortest: float
    longest: float
    mean: float
    deviation: float


class RoundTrips:
    """The newest round trips to one gateway."""

    def __init__(self) -> None:
        self._samples: deque[float] = deque(maxlen=SAMPLES)

    @property
    def last(self) -> float:
        """The newest one [s]; 0 if there is none."""
        return self._samples[-1] if self._samples else 0.0

    def add(self, seconds: float) -> None:
        """Takes note of one."""
        self._samples.append(seconds)

    def latency(self) -> Latency | None:
        """Returns what they come to; None where there is none."""
        if not self._samples:
            return None
        mean = statistics.fmean(self._samples)
        deviation = statistics.fmean(abs(one - mean) for one in self._samples)
        return Latency(min(self._samples), max(self._samples), mean, deviation)
