"""Progress towards a goal: whether the remaining way becomes shorter.

The remaining way is that along the global plan, through what is known. It may become longer whenever the robot
discovers an obstacle on its way, so such a discovery starts the watch afresh, but only a few times a goal: a robot
that drives to and fro between two blocked ways is thus found out.
"""

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class ProgressLimits:
    """Parameters of the watch: times [s], distances [m].

    Args:
        distance: the remaining way must be shorter by this than the least so far.
        timeout: longest time without that; 0 or less disables the watch.
        patience: additional time after each recovery behaviour.
        recoveries: number of recovery behaviours.
        resets: how often a goal's watch starts afresh because obstacles on the way changed.
        scale: longest time for a goal, as a multiple of the time that its first plan takes at ``speed``; 0: no limit.
        least_total: the longest time for a goal is at least this.
        speed: the robot's top speed [m/s].
    """

    distance: float = 0.5
    timeout: float = 22.0
    patience: float = 5.0
    recoveries: int = 0
    resets: int = 5
    scale: float = 10.0
    least_total: float = 120.0
    speed: float = 1.0

    def total(self, way: float) -> float:
        """Returns the longest time [s] for a goal whose first plan is ``way`` [m] long."""
        if self.scale <= 0.0 or self.speed <= 0.0:
            return math.inf
        return max(self.least_total, self.scale * way / self.speed)


@dataclass(frozen=True)
class Progress:
    """State of the watch for one goal; times are ROS times [s].

    Args:
        since: time of the last progress, or of the obstacle from which the watch started afresh.
        least: shortest remaining way since then [m]; infinite before the first plan.
        changed: time when a new obstacle was last found on the way; minus infinity if there was none.
        longest: longest remaining way since then [m].
        resets: how often the watch has started afresh.
        recoveries: recovery behaviours that have ended since the last progress.
        ends: when the goal's total time is over.
    """

    since: float = 0.0
    least: float = math.inf
    changed: float = -math.inf
    longest: float = -math.inf
    resets: int = 0
    recoveries: int = 0
    ends: float = math.inf

    def discovered(self, now: float) -> "Progress":
        """Returns the state after an obstacle was found on the way that was not known before."""
        return replace(self, changed=now, longest=-math.inf)

    def noted(self, remaining: float, now: float, limits: ProgressLimits) -> "Progress":
        """Returns the state after ``remaining`` [m] was measured.

        If time is up and an obstacle was found on the way meanwhile, the watch starts afresh from that time.
        """
        if math.isinf(self.least):
            return replace(self, since=now, least=remaining, ends=now + limits.total(remaining))
        state = replace(self, longest=max(self.longest, remaining))
        if (
            state.stalls(now, limits)
            and state.changed > state.since
            and state.resets < limits.resets
        ):
            state = replace(
                state,
                since=state.changed,
                least=state.longest,
                resets=state.resets + 1,
                recoveries=0,
            )
        if remaining <= state.least - limits.distance:
            return replace(state, since=now, least=remaining, recoveries=0)
        return state

    def stalls(self, now: float, limits: ProgressLimits) -> bool:
        """Returns whether it is time for the next recovery behaviour, or to give up after the last one."""
        if limits.timeout <= 0.0 or math.isinf(self.least):
            return False
        return now - self.since > limits.timeout + limits.patience * min(
            self.recoveries, limits.recoveries
        )

    def is_hopeless(self, now: float, limits: ProgressLimits) -> bool:
        """Returns whether even a robot that runs all recovery behaviours would have given up by now."""
        return 0.0 < limits.timeout < now - self.since - limits.patience * limits.recoveries

    def is_late(self, now: float) -> bool:
        """Returns whether the goal's total time is over."""
        return now > self.ends

    def delayed(self, time: float) -> "Progress":
        """Returns the state after a wait of ``time`` [s] that does not count."""
        return replace(self, since=self.since + time, ends=self.ends + time)

    def recovered(self, time: float) -> "Progress":
        """Returns the state after a recovery behaviour that took ``time`` [s]."""
        return replace(self.delayed(time), recoveries=self.recoveries + 1)
