"""What a real Pioneer's driver tells of its base: battery, bumpers, motors, sonar ring, under rosaria's names."""

import math
from typing import Any, Protocol

import rospy
from geometry_msgs.msg import Point32
from pioneer_msgs.msg import BumperState
from sensor_msgs.msg import BatteryState, PointCloud
from std_msgs.msg import Bool, Float32, Float64, Int8

from pioneer_gazebo import conversions
from pioneer_gazebo.core.battery import Battery, Wheel
from pioneer_gazebo.core.bumper import pressed
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.robot import BaseDriver
from pioneer_gazebo.core.schedule import Schedule, nanoseconds
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.topic import Topic, publish_while_alive

NOT_CHARGING = 0
"""Of rosaria's ``battery_recharge_state``."""


class Advertise(Protocol):
    """Makes a topic in the robot's namespace."""

    def __call__(self, name: str, message_class: type) -> Topic:
        """Returns the topic."""


class DriverTopics:
    """One robot's base.

    Publishes: ``battery_state`` (sensor_msgs/BatteryState), ``battery_voltage`` (std_msgs/Float64),
        ``battery_state_of_charge`` (std_msgs/Float32, 0 … 1), ``battery_recharge_state`` (std_msgs/Int8, latched),
        ``motors_state`` (std_msgs/Bool, latched), ``bumper_state`` (pioneer_msgs/BumperState) and, where the robot has
        sonars, ``sonar`` (sensor_msgs/PointCloud).
    Threads: all runs in the simulation's thread. The battery empties whether somebody looks or not.
    """

    def __init__(
        self,
        simulation: Simulation,
        schedule: Schedule,
        entity: Entity,
        config: BaseDriver,
        base: str,
        frame: str,
        advertise: Advertise,
    ) -> None:
        """Advertises below ``base`` and schedules; ``frame`` is the header's.

        Raises:
            RateError: the rate does not divide the simulator's.
        """
        self._simulation, self._schedule, self._entity, self._config = simulation, schedule, entity, config
        self._battery = Battery(config)
        self._drained = simulation.tick
        self._frame = frame
        self._state = advertise("battery_state", BatteryState)
        self._voltage = advertise("battery_voltage", Float64)
        self._charge = advertise("battery_state_of_charge", Float32)
        self._bumpers = advertise("bumper_state", BumperState)
        self._sonar = advertise("sonar", PointCloud) if entity.sonars else None
        self._latched: list[rospy.Publisher] = []
        self._task = schedule.add(f"{entity.name}: {config.name}", config.updateRate, self._update)
        for name, message in (("battery_recharge_state", Int8(NOT_CHARGING)), ("motors_state", Bool(True))):
            publisher = rospy.Publisher(f"{base}/{name}", type(message), latch=True, queue_size=1)
            publish_while_alive(publisher, message)
            self._latched.append(publisher)

    def close(self) -> None:
        """Takes back what `advertise` does not know of."""
        self._schedule.remove(self._task)
        for publisher in self._latched:
            publisher.unregister()

    def reset(self) -> None:
        """Charges the battery as it was when time began."""
        self._battery.reset()
        self._drained = self._simulation.tick

    def _update(self, tick: int) -> None:
        time = nanoseconds(tick)
        self._battery.drain((time - nanoseconds(self._drained)) * 1e-9, self._wheels())
        self._drained = tick
        if self._state.wanted:
            self._state.send(conversions.frame_of(self._battery_state(time)))
        if self._voltage.wanted:
            self._voltage.send(conversions.frame_of(Float64(self._battery.voltage)))
        if self._charge.wanted:
            self._charge.send(conversions.frame_of(Float32(self._battery.charge)))
        if self._bumpers.wanted:
            self._bumpers.send(conversions.frame_of(self._bumper_state(time)))
        if self._sonar is not None and self._sonar.wanted:
            self._sonar.send(conversions.frame_of(self._sonar_points(time)))

    def _wheels(self) -> list[Wheel]:
        wheels = []
        for driven in self._entity.drives:
            radius = driven.drive.config.wheelDiameter / 2
            states = self._simulation.joints(self._entity, driven.parts)
            efforts = self._simulation.efforts(self._entity, driven.parts)
            wheels += [Wheel(effort, rate, radius) for (_, rate), effort in zip(states, efforts, strict=True)]
        return wheels

    def _stamped(self, message: Any, time: int) -> Any:
        message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(time))
        message.header.frame_id = self._frame
        return message

    def _battery_state(self, time: int) -> BatteryState:
        battery, config = self._battery, self._config
        message = BatteryState(
            voltage=battery.voltage,
            current=-battery.current,
            charge=battery.charge * config.capacity,
            capacity=config.capacity,
            design_capacity=config.capacity,
            percentage=battery.charge,
            power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
            power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
            power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_UNKNOWN,
            present=True,
            temperature=math.nan,
        )
        return self._stamped(message, time)

    def _bumper_state(self, time: int) -> BumperState:
        back = self._simulation.pose(self._entity).inverse()
        points = [back.transform(one.position) for one in self._simulation.contacts(self._entity) if one.force > 0]
        front, rear = pressed(math.atan2(y, x) for x, y, _ in points)
        return self._stamped(BumperState(front_bumpers=front, rear_bumpers=rear), time)

    def _sonar_points(self, time: int) -> PointCloud:
        """Returns each sonar's reading as a point on its axis, in the frame of the base."""
        back = self._simulation.pose(self._entity).inverse()
        points = []
        for mounted in self._entity.sonars:
            config = mounted.laser.config
            nearest = float(self._simulation.ranges(self._entity, mounted).min())
            distance = min(max(nearest, config.min_range), config.max_range)
            sensor = self._simulation.link_pose(self._entity, config.link).compose(config.pose)
            points.append(Point32(*back.compose(sensor).transform((distance, 0.0, 0.0))))
        return self._stamped(PointCloud(points=points), time)
