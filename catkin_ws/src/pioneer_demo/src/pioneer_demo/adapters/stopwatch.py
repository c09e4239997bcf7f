"""Wall time since the command was typed."""

import os
import time
from pathlib import Path


class Stopwatch:
    """Counts from the start of this process, which ``exec`` does not change: set-up before it is counted in."""

    def __init__(self) -> None:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
        self._zero = time.monotonic() - age
        self.milestones: dict[str, float] = {}

    def seconds(self, moment: float | None = None) -> float:
        """Returns the seconds from the start to ``moment`` (``time.monotonic``), or to now."""
        return (time.monotonic() if moment is None else moment) - self._zero

    def note(self, name: str, moment: float | None = None) -> None:
        """Keeps the time of a milestone: the first one wins."""
        self.milestones.setdefault(name, round(self.seconds(moment), 3))
