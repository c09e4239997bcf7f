"""Measures wall time since the command was entered."""

import os
import time
from pathlib import Path


class Stopwatch:
    """Measures time since this process started. ``exec`` keeps the start time, so set-up before it is included."""

    def __init__(self) -> None:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
        self._zero = time.monotonic() - age
        self.milestones: dict[str, float] = {}

    def seconds(self, moment: float | None = None) -> float:
        """Returns the seconds from the start to ``moment`` (``time.monotonic``), or to now."""
        return (time.monotonic() if moment is None else moment) - self._zero

    def note(self, name: str, moment: float | None = None) -> None:
        """Records the time of a milestone, unless it is already recorded."""
        self.milestones.setdefault(name, round(self.seconds(moment), 3))
