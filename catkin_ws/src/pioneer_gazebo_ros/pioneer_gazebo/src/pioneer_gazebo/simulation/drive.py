"""Differential drive: converts commanded motion to wheel speeds, and wheel angles to odometry."""

import math
from dataclasses import dataclass

from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.world.robot import DiffDrive

GRIP_ACCELERATION = 4.0
"""Default limit of a wheel's rim acceleration [m/s²]; more would make it slip."""

TRIM_GAIN = 5.0
"""Wheel speed correction [rad/s] for each rad that the wheel lags behind its commanded rotation."""

TRIM_REACH = 0.05
"""Limit of the lag [rad]: a wheel that is blocked, for example by a wall, does not catch up later."""

SAME_SPEED = 1e-5
"""Smaller speed changes [rad/s] are not sent to the engine."""

FASTEST = 100.0
"""Maximum commanded speed [m/s and rad/s]."""


class CommandError(SimulatorError):
    """A velocity command or drive setting is invalid."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """The robot's estimated pose and velocity in its odom frame."""

    x: float = 0.0  #: [m]
    y: float = 0.0  #: [m]
    yaw: float = 0.0  #: [rad]
    speed: float = 0.0  #: forward [m/s]
    turn: float = 0.0  #: [rad/s]

    def towards(self, other: "Odometry", part: float) -> "Odometry":
        """Interpolates linearly towards ``other`` by ``part`` (0 … 1)."""
        turned = math.remainder(other.yaw - self.yaw, math.tau)
        return Odometry(
            x=self.x + part * (other.x - self.x),
            y=self.y + part * (other.y - self.y),
            yaw=self.yaw + part * turned,
            speed=self.speed + part * (other.speed - self.speed),
            turn=self.turn + part * (other.turn - self.turn),
        )


class Drive:
    """Two driven wheels: ramps their speeds to the last command and integrates their angles.

    As in a real drive, an integral term holds the wheels at their speeds: without it a robot at rest creeps by
    millimetres a second, because the engine's solver stops before the weight is exactly balanced.
    A command holds until the next one, as with gazebo_ros' plugin, unless ``commandTimeout`` ends it earlier, as in a
    real base, whose computer may fail while it drives.
    """

    def __init__(
        self, config: DiffDrive, left_scale: float = 1.0, right_scale: float = 1.0
    ) -> None:
        """Takes the plugin's settings; the scales are the ratios of assumed to true wheel diameter in odometry.

        Raises:
            CommandError: the separation or diameter is not positive.
        """
        if not (config.wheelSeparation > 0 and config.wheelDiameter > 0):
            raise CommandError(f"{config.name}: wheelSeparation and wheelDiameter must be above 0")
        self.config = config
        self._radius = config.wheelDiameter / 2
        self._scales = left_scale, right_scale
        self.reset()

    def reset(self) -> None:
        """Stops the wheels and resets the odometry to the origin."""
        self._wanted = self._motion = self._target = self._speeds = self._sent = self._behind = (
            0.0,
            0.0,
        )
        self._angles = (0.0, 0.0)
        self._silence = 0.0
        self.odometry = Odometry()

    def command(self, speed: float, turn: float) -> None:
        """Sets the motion [m/s, rad/s] to hold from the next step on.

        Raises:
            CommandError: a value is not finite or too large; the previous command remains in force.
        """
        check_motion(speed, turn)
        self._silence = 0.0
        self._wanted = speed, turn

    @property
    def at_rest(self) -> bool:
        """Whether the wheels are standing still and are commanded to."""
        return self._target == (0.0, 0.0) == self._speeds

    def wheel_speeds(self, step: float) -> tuple[float, float] | None:
        """Returns the left and right wheel speeds [rad/s] for the next ``step`` [s]; None if they are unchanged.

        Both wheels ramp in proportion, so that the robot stays on the same arc while it accelerates.
        """
        if self.config.commandTimeout:
            self._silence += step
            if self._silence > self.config.commandTimeout:
                self._wanted = (0.0, 0.0)
        if self._motion != self._wanted:
            self._steer(step)
        self._ramp(step)
        trimmed = (
            self._speeds[0] + TRIM_GAIN * self._behind[0],
            self._speeds[1] + TRIM_GAIN * self._behind[1],
        )
        if (
            abs(trimmed[0] - self._sent[0]) < SAME_SPEED
            and abs(trimmed[1] - self._sent[1]) < SAME_SPEED
        ):
            return None
        self._sent = trimmed
        return trimmed

    def _steer(self, step: float) -> None:
        """Moves the target motion closer to the commanded one, within the limits."""
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
        self._speeds = (
            self._target if part == 1.0 else (left + part * left_gap, right + part * right_gap)
        )

    def set_angles(self, left: float, right: float) -> None:
        """Takes the wheel angles [rad] over without a motion, after joints were set."""
        self._angles = left, right

    def measure(self, left: float, right: float, step: float) -> None:
        """Updates the odometry from the wheel angles [rad], 0 at the start, after a ``step`` [s].

        Displacement is along the heading before the step, as in the engine; using the mean heading would add a
        systematic error of half a step's turn that the wheels do not cause.
        """
        before = self._angles
        self._angles = left, right
        self._behind = (
            _behind(self._behind[0], self._speeds[0] * step, left - before[0]),
            _behind(self._behind[1], self._speeds[1] * step, right - before[1]),
        )
        left_way = (left - before[0]) * self._radius * self._scales[0]
        right_way = (right - before[1]) * self._radius * self._scales[1]
        way, turned = (
            (left_way + right_way) / 2,
            (right_way - left_way) / self.config.wheelSeparation,
        )
        was = self.odometry
        self.odometry = Odometry(
            was.x + way * math.cos(was.yaw), was.y + way * math.sin(was.yaw),
            math.remainder(was.yaw + turned, math.tau), way / step, turned / step,
        )  # fmt: skip


def _behind(before: float, wanted: float, turned: float) -> float:
    """Returns a wheel's lag [rad] after a step in which it should have turned by ``wanted``."""
    return min(max(before + wanted - turned, -TRIM_REACH), TRIM_REACH)


def check_motion(speed: float, turn: float) -> None:
    """Checks a motion [m/s, rad/s].

    Raises:
        CommandError: a value is not finite or too large.
    """
    if not (abs(speed) <= FASTEST and abs(turn) <= FASTEST):
        raise CommandError(
            f"velocity command must be finite and at most {FASTEST:g} m/s and rad/s (got {speed:g}, {turn:g})"
        )
