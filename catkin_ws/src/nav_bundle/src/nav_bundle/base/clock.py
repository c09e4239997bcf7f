"""Tells a clock that was set back from a world that has started again."""

from enum import Enum

RESET = 1.0
"""Simulated time that goes back by more than this [s] has started again; messages of /clock may overtake each other."""


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
