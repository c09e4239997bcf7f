"""A battery that a robot's electronics and motors empty.

Its open voltage falls in a line with its charge; under load the inner resistance takes its part. A motor draws the
power it gives to the wheel, over the drive's efficiency, and what its torque costs in its windings: a wheel that is
held up draws current without moving.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from pioneer_gazebo.core.robot import BaseDriver


@dataclass(frozen=True, slots=True)
class Wheel:
    """What a wheel does: torque [N m] of its motor, rate [rad/s] and radius [m]."""

    torque: float
    rate: float
    radius: float


class Battery:
    """One robot's battery."""

    def __init__(self, config: BaseDriver) -> None:
        """Begins with the charge of ``config``."""
        self.config = config
        self.charge = config.initialCharge  #: 0 (empty) … 1 (full)
        #: current: that is drawn [A]
        #: voltage: at its terminals [V]
        self.voltage, self.current = self._under(config.idlePower)

    def reset(self) -> None:
        """Restores the initial charge, under the idle load."""
        self.charge = self.config.initialCharge
        self.voltage, self.current = self._under(self.config.idlePower)

    def drain(self, seconds: float, wheels: Iterable[Wheel]) -> None:
        """Empties the battery by what is drawn in so many ``seconds``; an empty one stays empty."""
        power = self.config.idlePower + sum(self._motor_power(wheel) for wheel in wheels)
        self.voltage, self.current = self._under(power)
        self.charge = max(0.0, self.charge - self.current * seconds / (3600.0 * self.config.capacity))

    def _motor_power(self, wheel: Wheel) -> float:
        """Returns what a wheel's motor draws [W]; rolling takes its share, which the engine's balls do not know."""
        config = self.config
        rolling = config.rollingResistance / 2 * abs(wheel.rate) * wheel.radius
        given = max(0.0, wheel.torque * wheel.rate) + rolling
        return given / config.driveEfficiency + config.windingLoss * wheel.torque**2

    def _under(self, power: float) -> tuple[float, float]:
        """Returns voltage [V] and current [A] under a load [W], which is limited to what the battery can give."""
        config = self.config
        open_voltage = config.emptyVoltage + self.charge * (config.fullVoltage - config.emptyVoltage)
        root = math.sqrt(max(0.0, open_voltage**2 - 4.0 * config.resistance * power))
        voltage = (open_voltage + root) / 2
        return voltage, (open_voltage - voltage) / config.resistance
