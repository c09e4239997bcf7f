"""Tells a clock that was set back from a world that has started again, and from one that stands still."""

from enum import Enum

RESET = 1.0
"""Simulated time that goes back by more than this [s] has started again; messages of /clock may overtake each other."""

STALL = 2.0
"""Simulated time stands still if it is the same for longer than this [s of wall time]."""


class Jump(Enum):
    """What a clock has done since the last reading."""

    NONE = "none"
    STEP = "step"  #: it was set back, as by NTP; the world continues, and only times from before are useless
    RESET = "reset"  #: simulation or bag have started again; what was learnt of the world before is useless


class ClockWatch:
    """Classifies jumps of a node's clock.

    Only simulated time is reset: wall time is corrected, however far, and neither robot nor odometry start again.

    Args:
        simulated: whether the clock is /clock.
    """

    def __init__(self, simulated: bool) -> None:
        self._simulated = simulated
        self.now = 0.0  #: time of the last reading [s]

    def read(self, now: float) -> Jump:
        """Returns what the clock has done since the last reading, at time ``now`` [s]."""
        back = self.now - now
        self.now = now
        if back <= 0.0:
            return Jump.NONE
        return Jump.RESET if self._simulated and back > RESET else Jump.STEP


class StallWatch:
    """Notices that a clock stands still: the simulator is paused or has ended, or its link is cut."""

    def __init__(self) -> None:
        self._time = 0.0  # what the clock showed last [s]
        self._since: float | None = None  # since when [s of wall time]

    def read(self, now: float, wall: float) -> bool:
        """Returns whether the clock, which shows ``now`` [s], has stood still at ``wall`` [s of wall time]."""
        if self._since is None or now != self._time:
            self._time, self._since = now, wall
        return wall - self._since > STALL
