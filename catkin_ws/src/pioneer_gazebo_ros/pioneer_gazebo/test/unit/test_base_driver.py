"""Battery and bumpers, checked against values computed by hand."""

import math
from dataclasses import replace

import pytest

from pioneer_gazebo.sensors.base import Battery, Wheel, pressed
from pioneer_gazebo.world.robot import BaseDriver
from pioneer_gazebo.world.urdf import robot_from_urdf

CONFIG = BaseDriver(
    capacity=1.0, fullVoltage=12.0, emptyVoltage=10.0, resistance=0.0625, idlePower=11.9375, rollingResistance=0.0,
    driveEfficiency=0.5, windingLoss=2.0,
)  # fmt: skip


def test_idle_power_and_inner_resistance_give_voltage_and_current():
    battery = Battery(CONFIG)
    assert battery.voltage == pytest.approx(11.9375)
    assert battery.current == pytest.approx(1.0)
    assert battery.voltage * battery.current == pytest.approx(CONFIG.idlePower)


def test_a_current_of_one_ampere_takes_a_tenth_of_one_ampere_hour_in_six_minutes():
    battery = Battery(CONFIG)
    for _ in range(360):
        battery.drain(1.0, [])
    assert battery.charge == pytest.approx(0.9, abs=0.002)
    assert battery.voltage == pytest.approx(10.0 + 0.9 * 2.0 - 0.0625, abs=0.01)


def test_a_driving_wheel_draws_its_power_over_the_efficiency_and_a_held_one_draws_too():
    def power(*wheels, **options):
        battery = Battery(replace(CONFIG, **options))
        battery.drain(1e-9, wheels)
        return battery.voltage * battery.current - CONFIG.idlePower

    assert power(Wheel(0.5, 4.0, 0.1), windingLoss=0.0) == pytest.approx(4.0)
    assert power(
        Wheel(0.0, 5.0, 0.1), Wheel(0.0, 5.0, 0.1), rollingResistance=3.0
    ) == pytest.approx(3.0)
    assert power(Wheel(1.0, 0.0, 0.1)) == pytest.approx(2.0)
    assert power(Wheel(-0.5, 4.0, 0.1), windingLoss=0.0) == pytest.approx(0.0), (
        "braking gives nothing back"
    )


def test_an_empty_battery_stays_empty_and_a_reset_charges_it():
    battery = Battery(CONFIG)
    battery.drain(1e6, [])
    assert battery.charge == 0.0
    battery.drain(1.0, [Wheel(1e6, 10.0, 0.1)])
    assert battery.charge == 0.0
    assert math.isfinite(battery.voltage)
    battery.reset()
    assert battery.charge == 1.0


def test_segments_go_from_left_to_right_in_front_and_behind():
    def rings(degrees):
        front, rear = pressed([math.radians(degrees)])
        return [i for i, on in enumerate(front) if on], [i for i, on in enumerate(rear) if on]

    assert rings(0) == ([2], [])
    assert rings(80) == ([0], [])
    assert rings(-80) == ([4], [])
    assert rings(100) == ([], [0])
    assert rings(180) == ([], [2])
    assert rings(-100) == ([], [4])
    assert pressed([]) == ([False] * 5, [False] * 5)


@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ("<capacity>0</capacity>", "capacity must be above 0"),
        ("<initialCharge>2</initialCharge>", "at most 1"),
    ],
)
def test_a_plugin_whose_battery_makes_no_sense_is_left_out_with_the_reason(setting, word):
    plugin = f"<plugin name='b' filename='libpioneer_base_driver.so'>{setting}</plugin>"
    robot = robot_from_urdf(
        f"<robot name='r'><link name='base_link'/><gazebo>{plugin}</gazebo></robot>"
    )
    assert any(word in note for note in robot.warnings)
