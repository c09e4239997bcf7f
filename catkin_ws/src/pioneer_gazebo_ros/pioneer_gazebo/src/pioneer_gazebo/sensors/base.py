"""What a real Pioneer's driver reports about its base: battery, bumper rings, sonar points.

The battery is drained by electronics and motors. The open-circuit voltage falls linearly with the charge; the internal
resistance lowers the terminal voltage under load. A motor draws its mechanical output divided by the drive's
efficiency, plus its winding losses: a stalled wheel draws current without moving.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.pose import Vector
from pioneer_gazebo.world.robot import BaseDriver


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
        self.reset()

    def reset(self) -> None:
        """Restores the initial charge, under the idle load."""
        self.charge = self.config.initialCharge  #: 0 (empty) … 1 (full)
        #: current: drawn from the battery [A]
        #: voltage: at its terminals [V]
        self.voltage, self.current = self._under(self.config.idlePower)

    def drain(self, seconds: float, wheels: Iterable[Wheel]) -> None:
        """Discharges the battery by the consumption over ``seconds``; an empty battery stays empty."""
        power = self.config.idlePower + sum(self._motor_power(wheel) for wheel in wheels)
        self.voltage, self.current = self._under(power)
        self.charge = max(
            0.0, self.charge - self.current * seconds / (3600.0 * self.config.capacity)
        )

    def _motor_power(self, wheel: Wheel) -> float:
        """Returns a motor's consumption [W], including rolling resistance, which the engine's balls do not have."""
        config = self.config
        rolling = config.rollingResistance / 2 * abs(wheel.rate) * wheel.radius
        given = max(0.0, wheel.torque * wheel.rate) + rolling
        return given / config.driveEfficiency + config.windingLoss * wheel.torque**2

    def _under(self, power: float) -> tuple[float, float]:
        """Returns voltage [V] and current [A] under a load [W], limited to the battery's maximum power."""
        config = self.config
        open_voltage = config.emptyVoltage + self.charge * (
            config.fullVoltage - config.emptyVoltage
        )
        root = math.sqrt(max(0.0, open_voltage**2 - 4.0 * config.resistance * power))
        voltage = (open_voltage + root) / 2
        return voltage, (open_voltage - voltage) / config.resistance


SEGMENTS = 5
"""Number of segments per ring, evenly spaced from the robot's left to its right."""


def pressed(bearings: Iterable[float]) -> tuple[list[bool], list[bool]]:
    """Returns the pressed segments of the front and the rear ring.

    Args:
        bearings: of the contacts as seen from the robot's centre [rad], 0 ahead, positive to the left.
    """
    rings = [False] * SEGMENTS, [False] * SEGMENTS
    for bearing in bearings:
        from_left = math.remainder(bearing, math.tau)
        behind = abs(from_left) > math.pi / 2
        part = (from_left % math.tau - math.pi / 2) if behind else (math.pi / 2 - from_left)
        rings[behind][min(SEGMENTS - 1, max(0, int(part / math.pi * SEGMENTS)))] = True
    return rings


def wheels_of(simulation: Simulation, entity: Entity) -> list[Wheel]:
    """Returns effort, rate and radius of each driven wheel."""
    wheels = []
    for driven in entity.drives:
        radius = driven.drive.config.wheelDiameter / 2
        states = simulation.joints(entity, driven.parts)
        efforts = simulation.efforts(entity, driven.parts)
        wheels += [
            Wheel(effort, rate, radius) for (_, rate), effort in zip(states, efforts, strict=True)
        ]
    return wheels


def pressed_bumpers(simulation: Simulation, entity: Entity) -> tuple[list[bool], list[bool]]:
    """Returns which segments of the front and rear bumper are pressed."""
    back = simulation.pose(entity).inverse()
    points = [back.transform(one.position) for one in simulation.contacts(entity) if one.force > 0]
    return pressed(math.atan2(y, x) for x, y, _ in points)


def sonar_points(simulation: Simulation, entity: Entity) -> list[Vector]:
    """Returns each sonar reading as a point on the sonar's axis, in the base frame [m]."""
    back = simulation.pose(entity).inverse()
    points = []
    for mounted in entity.sonars:
        sensor = simulation.link_pose(entity, mounted.device.link).compose(mounted.device.pose)
        reading = (simulation.distance(entity, mounted), 0.0, 0.0)
        points.append(back.compose(sensor).transform(reading))
    return points
