"""Latency statistics of the links to other gateways."""

import statistics
from collections import deque
from dataclasses import dataclass

SAMPLES = 5
"""Number of round trips kept for each gateway, as in rocon."""


@dataclass(frozen=True, slots=True)
class Latency:
    """Statistics of the newest round trips between two relays, including queueing on the link [s]."""

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
        """The newest round trip [s]; 0 if there is none."""
        return self._samples[-1] if self._samples else 0.0

    def add(self, seconds: float) -> None:
        """Adds a round trip [s]."""
        self._samples.append(seconds)

    def latency(self) -> Latency | None:
        """Returns the statistics; None if there are no round trips."""
        if not self._samples:
            return None
        mean = statistics.fmean(self._samples)
        deviation = statistics.fmean(abs(one - mean) for one in self._samples)
        return Latency(min(self._samples), max(self._samples), mean, deviation)
