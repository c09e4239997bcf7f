"""Differential drive: from a commanded motion to wheel speeds, and from wheel angles to odometry."""

import math
from dataclasses import dataclass

from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.core.robot import DiffDrive

GRIP_ACCELERATION = 4.0
"""A wheel's rim speed changes by at most this [m/s²] where the robot names no limit: more would make it slip."""

TRIM_GAIN = 5.0
"""How hard a wheel's speed is trimmed [rad/s] for each rad it is behind where its speeds should have brought it."""

TRIM_REACH = 0.05
"""A wheel that is held up, by a wall say, is taken to be at most this far behind [rad]: it does not catch up later."""

SAME_SPEED = 1e-5
"""Speeds that differ by less [rad/s] are not sent to the engine again."""

FASTEST = 100.0
"""No command may be faster [m/s and rad/s]."""


class CommandError(SimulatorError):
    """A command that no robot can follow."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """Where the robot believes it is, in its odom frame."""

    x: float = 0.0  #: [m]
    y: float = 0.0  #: [m]
    yaw: float = 0.0  #: [rad]
    speed: float = 0.0  #: forward [m/s]
    turn: float = 0.0  #: [rad/s]

    def towards(self, other: "Odometry", part: float) -> "Odometry":
        """Returns the state at ``part`` (0 … 1) of the way to ``other``."""
        turned = math.remainder(other.yaw - self.yaw, math.tau)
        return Odometry(
            self.x + part * (other.x - self.x), self.y + part * (other.y - self.y), self.yaw + part * turned,
            other.speed, other.turn,
        )  # fmt: skip


class Drive:
    """Two driven wheels: ramps their speeds to what was commanded last and integrates their angles.

    As in a real drive, an integral term holds the wheels to their speeds: without it a robot at rest creeps by
    millimetres a second, because the engine's solver ends before the last bit of weight is balanced.
    The last command holds until the next, as with gazebo_ros' plugin, unless ``commandTimeout`` ends it first, as in
    a real base, whose computer may die while it drives.
    """

    def __init__(self, config: DiffDrive, left_scale: float = 1.0, right_scale: float = 1.0) -> None:
        """Takes the plugin's settings; the scales are what odometry believes of each wheel's true diameter.

        Raises:
            CommandError: a separation or diameter that is not positive.
        """
        if not (config.wheelSeparation > 0 and config.wheelDiameter > 0):
            raise CommandError(f"{config.name}: wheelSeparation and wheelDiameter must be above 0")
        self.config = config
        self._radius = config.wheelDiameter / 2
        self._scales = left_scale, right_scale
        self._wanted = self._motion = (0.0, 0.0)
        self._target = (0.0, 0.0)
        self._silence = 0.0
        self._speeds = (0.0, 0.0)
        self._sent = (0.0, 0.0)
        self._behind = (0.0, 0.0)
        self._angles = (0.0, 0.0)
        self.odometry = Odometry()

    def command(self, speed: float, turn: float) -> None:
        """Takes a motion [m/s, rad/s] to hold from the next step on.

        Raises:
            CommandError: a value that is not finite; the previous command holds.
        """
        check_motion(speed, turn)
        self._silence = 0.0
        self._wanted = speed, turn

    @property
    def at_rest(self) -> bool:
        """Whether the wheels stand and shall stand."""
        return self._target == (0.0, 0.0) == self._speeds

    def wheel_speeds(self, step: float) -> tuple[float, float] | None:
        """Returns the wheels' speeds [rad/s], left and right, for the next ``step`` [s]; None where nothing changes.

        Both wheels ramp in proportion, so that an arc stays the same arc while the robot gains speed.
        """
        if self.config.commandTimeout:
            self._silence += step
            if self._silence > self.config.commandTimeout:
                self._wanted = (0.0, 0.0)
        if self._motion != self._wanted:
            self._steer(step)
        self._ramp(step)
        trimmed = self._speeds[0] + TRIM_GAIN * self._behind[0], self._speeds[1] + TRIM_GAIN * self._behind[1]
        if abs(trimmed[0] - self._sent[0]) < SAME_SPEED and abs(trimmed[1] - self._sent[1]) < SAME_SPEED:
            return None
        self._sent = trimmed
        return trimmed

    def _steer(self, step: float) -> None:
        """Brings the motion that is asked of the wheels nearer to the commanded one, within the limits."""
        (speed, turn), config = self._motion, self.config
        speed = config.speedLimits.towards(speed, self._wanted[0], step)
        turn = config.turnLimits.towards(turn, self._wanted[1], step)
        self._motion = speed, turn
        half = turn * config.wheelSeparation / 2
        self._target = (speed - half) / self._radius, (speed + half) / self._radius

    def _ramp(self, step: float) -> None:
        (left, right), (left_target, right_target) = self._speeds, self._target
        left_gap, right_gap = left_target - left, right_target - right
        gap = max(abs(left_gap), abs(right_gap))
        if gap == 0.0:
            return
        most = (self.config.wheelAcceleration or GRIP_ACCELERATION) / self._radius * step
        part = min(1.0, most / gap)
        self._speeds = self._target if part == 1.0 else (left + part * left_gap, right + part * right_gap)

    def measure(self, left: float, right: float, step: float) -> None:
        """Takes the wheels' angles [rad], 0 at the start, after a ``step`` [s] and moves the odometry on.

        The way is laid along the heading before the step, as the engine does it; the mean heading would add a
        systematic error of half a step's turn that no wheel causes.
        """
        before = self._angles
        self._angles = left, right
        self._behind = (
            _behind(self._behind[0], self._speeds[0] * step, left - before[0]),
            _behind(self._behind[1], self._speeds[1] * step, right - before[1]),
        )
        left_way = (left - before[0]) * self._radius * self._scales[0]
        right_way = (right - before[1]) * self._radius * self._scales[1]
        way, turned = (left_way + right_way) / 2, (right_way - left_way) / self.config.wheelSeparation
        was = self.odometry
        self.odometry = Odometry(
            was.x + way * math.cos(was.yaw), was.y + way * math.sin(was.yaw),
            math.remainder(was.yaw + turned, math.tau), way / step, turned / step,
        )  # fmt: skip

    def reset(self) -> None:
        """Stops the wheels and puts the odometry back to the origin."""
        self._wanted = self._motion = self._target = self._speeds = self._sent = self._behind = (0.0, 0.0)
        self._angles = (0.0, 0.0)
        self.odometry = Odometry()


def _behind(before: float, wanted: float, turned: float) -> float:
    """Returns how far a wheel is behind [rad] after a step in which it should have turned by ``wanted``."""
    return min(max(before + wanted - turned, -TRIM_REACH), TRIM_REACH)


def check_motion(speed: float, turn: float) -> None:
    """Checks a motion [m/s, rad/s].

    Raises:
        CommandError: a value that is not finite or too great.
    """
    if not (abs(speed) <= FASTEST and abs(turn) <= FASTEST):
        raise CommandError(
            f"velocity command must be finite and at most {FASTEST:g} m/s and rad/s (got {speed:g}, {turn:g})"
        )
