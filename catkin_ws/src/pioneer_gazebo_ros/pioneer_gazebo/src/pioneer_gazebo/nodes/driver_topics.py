"""Publishes what a real Pioneer's driver reports: battery, bumpers, motors, sonar ring, under rosaria's names."""

import math
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Point32
from pioneer_msgs.msg import BumperState
from sensor_msgs.msg import BatteryState, PointCloud
from std_msgs.msg import Bool, Float32, Float64, Int8

from pioneer_gazebo import conversions
from pioneer_gazebo.core.base import Battery, pressed_bumpers, sonar_points, wheels_of
from pioneer_gazebo.core.robot import BaseDriver
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.nodes.port import Port

NOT_CHARGING = 0
"""A value of rosaria's ``battery_recharge_state``."""


def driver_topics(port: Port, config: BaseDriver) -> None:
    """Publishes the base data of one robot.

    ``battery_state`` (sensor_msgs/BatteryState), ``battery_voltage`` (std_msgs/Float64), ``battery_state_of_charge``
    (std_msgs/Float32, 0 … 1), ``battery_recharge_state`` (std_msgs/Int8, latched), ``motors_state`` (std_msgs/Bool,
    latched), ``bumper_state`` (pioneer_msgs/BumperState) and, if the robot has sonars, ``sonar``
    (sensor_msgs/PointCloud). The battery drains whether or not there are subscribers.
    """
    simulation, entity, frame = port.simulation, port.entity, port.frame(config.frameName)
    battery = Battery(config)
    drained = [simulation.tick]

    def bumper_state() -> BumperState:
        front, rear = pressed_bumpers(simulation, entity)
        return BumperState(front_bumpers=front, rear_bumpers=rear)

    def cloud() -> PointCloud:
        return PointCloud(points=[Point32(*one) for one in sonar_points(simulation, entity)])

    makers: list[tuple[str, type, Callable[[], Any]]] = [
        ("battery_state", BatteryState, lambda: battery_state(battery)),
        ("battery_voltage", Float64, lambda: Float64(battery.voltage)),
        ("battery_state_of_charge", Float32, lambda: Float32(battery.charge)),
        ("bumper_state", BumperState, bumper_state),
    ]
    if entity.sonars:
        makers.append(("sonar", PointCloud, cloud))
    topics = [(port.topic(name, kind), make) for name, kind, make in makers]

    def update(tick: int) -> None:
        time = nanoseconds(tick)
        battery.drain((time - nanoseconds(drained[0])) * 1e-9, wheels_of(simulation, entity))
        drained[0] = tick
        for topic, make in topics:
            if topic.wanted:
                topic.send(conversions.stamped_frame(make(), time, frame))

    def reset() -> None:
        battery.reset()
        drained[0] = simulation.tick

    port.on_reset.append(reset)
    port.every(config.updateRate, config.name, update, always=True)
    port.latched("battery_recharge_state", Int8(NOT_CHARGING))
    port.latched("motors_state", Bool(True))


def battery_state(battery: Battery) -> BatteryState:
    """Returns the BatteryState of a battery, without a header."""
    config = battery.config
    return BatteryState(
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
