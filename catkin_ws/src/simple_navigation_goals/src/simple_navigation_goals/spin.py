"""Spin recovery: decides when a robot that has a goal but stands should turn in place, and in which direction."""

from dataclasses import dataclass, replace

SLOW = 0.001
"""Commanded speed [m/s] below which the robot counts as standing."""
PATIENCE = 5.0
"""How long the robot has to stand until it is turned [s of ROS time]."""
DURATION = 1.5
"""Duration of a turn [s of ROS time]."""


@dataclass(frozen=True)
class SpinState:
    """State of the recovery."""

    now: float = 0.0  #: time of the newest step [s]
    #: start of the time with an active goal but without a moving command [s]; None if the robot does not stand
    standing_since: float | None = None
    turning_until: float | None = (
        None  #: end of the current turn [s]; None if the robot does not turn
    )
    direction: float = 1.0  #: turning direction commanded last: 1 counter-clockwise, -1 clockwise
    active: bool = False  #: whether move_base has an active goal
    blind: bool = False  #: whether move_base stops the robot because an input is missing

    @property
    def turning(self) -> bool:
        """Whether the recovery is turning the robot."""
        return self.turning_until is not None


def commanded(
    state: SpinState, max_vel_theta: float, linear: float, angular: float, now: float
) -> SpinState:
    """Returns the state after move_base commanded ``linear`` [m/s] and ``angular`` [rad/s] at ROS time ``now`` [s].

    A command that drives, or turns at the local planner's ``max_vel_theta`` [rad/s], ends the standing. A command that
    turns sets the direction of the next turn, but does not change a turn in progress.
    """
    if angular != 0.0 and not state.turning:
        state = replace(state, direction=1.0 if angular > 0.0 else -1.0)
    if abs(linear) >= SLOW or abs(angular) >= max_vel_theta:
        state = replace(state, standing_since=None)
    return advanced(state, now)


def watched(state: SpinState, active: bool, now: float) -> SpinState:
    """Returns the state after move_base's status reported whether a goal is ``active``, at ROS time ``now`` [s]."""
    return advanced(replace(state, active=active), now)


def blinded(state: SpinState, blind: bool, now: float) -> SpinState:
    """Returns the state after move_base reported whether its robot is ``blind``, at ROS time ``now`` [s].

    A blind robot is not turned: nobody knows what is beside it.
    """
    return advanced(replace(state, blind=blind), now)


def advanced(state: SpinState, now: float) -> SpinState:
    """Returns the state at ROS time ``now`` [s]: a turn starts after `PATIENCE` of standing and lasts `DURATION`.

    Without an active goal, or while the robot is blind, there is no turn. When time jumps back, the wait restarts.
    """
    if not state.active or state.blind or now < state.now:
        return replace(state, now=now, standing_since=None, turning_until=None)
    if state.turning_until is not None:
        over = now >= state.turning_until
        return replace(
            state, now=now, standing_since=None, turning_until=None if over else state.turning_until
        )
    since = now if state.standing_since is None else state.standing_since
    until = now + DURATION if now - since >= PATIENCE else None
    return replace(state, now=now, standing_since=since, turning_until=until)
