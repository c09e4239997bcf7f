"""Battery model: drained by a robot's electronics and motors.

The open-circuit voltage falls linearly with the charge; the internal resistance lowers the terminal voltage under load.
A motor draws its mechanical output divided by the drive's efficiency, plus its winding losses: a stalled wheel draws
current without moving.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from pioneer_gazebo.core.robot import BaseDriver


@dataclass(frozen=True, slots=True)
class Wheel:
    """State of a wheel: motor torque [N m], rate [rad/s] and radius [m]."""

    torque: float
    rate: float
    radius: float


class Battery:
    """The battery of one robot."""

    def __init__(self, config: BaseDriver) -> None:
        """Starts with the initial charge of ``config``."""
        self.config = config
        self.charge = config.initialCharge  #: 0 (empty) … 1 (full)
        #: current: drawn from the battery [A]
        #: voltage: at its terminals [V]
        self.voltage, self.current = self._under(config.idlePower)

    def reset(self) -> None:
        """Restores the initial charge, under the idle load."""
        self.charge = self.config.initialCharge
        self.voltage, self.current = self._under(self.config.idlePower)

    def drain(self, seconds: float, wheels: Iterable[Wheel]) -> None:
        """Discharges the battery by the consumption over ``seconds``; an empty battery stays empty."""
        power = self.config.idlePower + sum(self._motor_power(wheel) for wheel in wheels)
        self.voltage, self.current = self._under(power)
        self.charge = max(0.0, self.charge - self.current * seconds / (3600.0 * self.config.capacity))

    def _motor_power(self, wheel: Wheel) -> float:
        """Returns a motor's consumption [W], including rolling resistance, which the engine's balls do not have."""
        config = self.config
        rolling = config.rollingResistance / 2 * abs(wheel.rate) * wheel.radius
        given = max(0.0, wheel.torque * wheel.rate) + rolling
        return given / config.driveEfficiency + config.windingLoss * wheel.torque**2

    def _under(self, power: float) -> tuple[float, float]:
        """Returns voltage [V] and current [A] under a load [W], limited to the battery's maximum power."""
        config = self.config
        open_voltage = config.emptyVoltage + self.charge * (config.fullVoltage - config.emptyVoltage)
        root = math.sqrt(max(0.0, open_voltage**2 - 4.0 * config.resistance * power))
        voltage = (open_voltage + root) / 2
        return voltage, (open_voltage - voltage) / config.resistance
