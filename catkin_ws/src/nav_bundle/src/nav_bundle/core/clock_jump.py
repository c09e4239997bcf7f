"""Detects a clock that jumps back, as in a simulation reset, and late stamps from before the jump."""

import math

MOST_AHEAD = 5.0
"""Transforms are stamped less than this far ahead of the clock [s]; amcl's are ahead by its transform_tolerance."""


class ClockJump:
    """Detects jumps back in time, and which stamps precede the jump. Times are ROS times [s].

    /clock and stamped messages arrive on separate connections, so the last transforms from before the jump may arrive
    after it. If accepted, they would count as the newest until the clock reaches that time again.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._before = -math.inf

    def jumped(self, now: float) -> bool:
        """Stores the time ``now``; returns whether it is earlier than the last one."""
        back = now < self.now
        if back:
            self._before = max(self._before, self.now)
        self.now = now
        return back

    def is_of_before(self, stamp: float) -> bool:
        """Returns whether ``stamp`` precedes the last jump: it is far ahead, and the clock has not caught up yet."""
        return self.now < self._before and stamp > self.now + MOST_AHEAD
