"""Spin recovery: decides when a robot that has a goal but stands should turn in place, and in which direction."""

from dataclasses import dataclass, replace

SLOW = 0.001
"""Commanded speed [m/s] below which the robot counts as standing."""


@dataclass(frozen=True)
class SpinConfig:
    """Times [s, ROS time] and the turning speed [rad/s]; ``max_vel_theta`` is the local planner's."""

    max_vel_theta: float = 1.0
    patience: float = 5.0
    duration: float = 1.5


@dataclass(frozen=True)
class SpinState:
    """State of the recovery."""

    now: float = 0.0  #: time of the newest step [s]
    #: start of the time with an active goal but without a moving command [s]; None if the robot does not stand
    standing_since: float | None = None
    turning_until: float | None = None  #: end of the current turn [s]; None if the robot does not turn
    direction: float = 1.0  #: turning direction commanded last: 1 counter-clockwise, -1 clockwise
    active: bool = False  #: whether move_base has an active goal

    @property
    def turning(self) -> bool:
        """Whether the recovery is turning the robot."""
        return self.turning_until is not None


def commanded(state: SpinState, config: SpinConfig, linear: float, angular: float, now: float) -> SpinState:
    """Returns the state after move_base commanded ``linear`` [m/s] and ``angular`` [rad/s] at ROS time ``now`` [s].

    A command that drives, or turns at full speed, ends the standing. A command that turns sets the direction of the
    next turn, but does not change a turn in progress.
    """
    if angular != 0.0 and not state.turning:
        state = replace(state, direction=1.0 if angular > 0.0 else -1.0)
    if abs(linear) >= SLOW or abs(angular) >= config.max_vel_theta:
        state = replace(state, standing_since=None)
    return advanced(state, config, now)


def watched(state: SpinState, config: SpinConfig, active: bool, now: float) -> SpinState:
    """Returns the state after move_base's status reported whether a goal is ``active``, at ROS time ``now`` [s]."""
    return advanced(replace(state, active=active), config, now)


def advanced(state: SpinState, config: SpinConfig, now: float) -> SpinState:
    """Returns the state at ROS time ``now`` [s]: a turn starts after ``patience`` of standing and lasts ``duration``.

    Without an active goal there is no turn. When time jumps back, the wait restarts.
    """
    if not state.active or now < state.now:
        return replace(state, now=now, standing_since=None, turning_until=None)
    if state.turning_until is not None:
        over = now >= state.turning_until
        return replace(state, now=now, standing_since=None, turning_until=None if over else state.turning_until)
    since = now if state.standing_since is None else state.standing_since
    until = now + config.duration if now - since >= config.patience else None
    return replace(state, now=now, standing_since=since, turning_until=until)
