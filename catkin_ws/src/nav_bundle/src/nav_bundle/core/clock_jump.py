"""A clock that jumps back, as when a simulation is reset, and what of the time before still comes after it."""

import math

MOST_AHEAD = 5.0
"""A transform is stamped less far ahead of its clock than this [s]: amcl's by its transform_tolerance."""


class ClockJump:
    """Tells that time jumped back, and which stamps are of the time before. Times are ROS times [s].

    The clock and what is stamped come on connections of their own, so that the last transforms of the time before may
    come after the first moment of the new one. Among the new ones they would pass for the newest until that time comes
    again.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._before = -math.inf

    def jumped(self, now: float) -> bool:
        """Takes the time, and tells whether it is earlier than the one taken last."""
        back = now < self.now
        if back:
            self._before = max(self._before, self.now)
        self.now = now
        return back

    def is_of_before(self, stamp: float) -> bool:
        """Tells whether ``stamp`` is of the time before the last jump: far ahead of now, which has yet to get there."""
        return self.now < self._before and stamp > self.now + MOST_AHEAD
