"""Realistic noise: encoders and lasers of every robot have at least that of real ones."""

import dataclasses

import numpy as np
import pytest
from conftest import MakeSimulation

from pioneer_gazebo.simulation.noise_profile import DESCRIBED, PROFILES, REALISTIC
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import LaserSensor, Robot

ROBOTS = 12
SCANS = 40


def with_laser(robot: Robot, **fields: float) -> Robot:
    """Returns the robot with other settings of its laser."""
    devices = tuple(
        dataclasses.replace(one, **fields) if isinstance(one, LaserSensor) else one
        for one in robot.devices
    )
    return dataclasses.replace(robot, devices=devices)


def test_the_described_noise_changes_no_sensor(simulate: MakeSimulation, robot: Robot) -> None:
    entity = simulate(noise=DESCRIBED).add_robot("p", "p", robot, Pose())
    assert [mounted.laser.config for mounted in entity.lasers] == list(robot.lasers)


def test_realistic_lasers_differ_by_what_is_common_to_a_lasers_ranges(
    simulate: MakeSimulation, robot: Robot
) -> None:
    simulation = simulate(noise=REALISTIC)
    silent = with_laser(robot, noise_stddev=0.0)
    entities = [
        simulation.add_robot(f"p{number}", f"p{number}", silent, Pose((2.0 * number, 0.0, 0.0)))
        for number in range(ROBOTS)
    ]
    configs = [entity.lasers[0].laser.config for entity in entities]
    assert {one.noise_stddev for one in configs} == {REALISTIC.laser_stddev}
    biases = np.array([one.noise_mean for one in configs])
    assert len(set(biases)) == ROBOTS
    assert np.abs(biases).max() <= REALISTIC.laser_bias
    assert biases.std() > 0.3 * REALISTIC.laser_bias


def test_a_laser_that_is_described_as_noisier_stays_so(
    simulate: MakeSimulation, robot: Robot
) -> None:
    entity = simulate(noise=REALISTIC).add_robot(
        "p", "p", with_laser(robot, noise_stddev=0.05), Pose()
    )
    assert entity.lasers[0].laser.config.noise_stddev == 0.05


def test_realistic_encoders_are_wrong_by_half_a_percent_and_the_same_for_a_seed(
    simulate: MakeSimulation, robot: Robot
) -> None:
    def rates(seed: int) -> list[tuple[float, float]]:
        simulation = simulate(seed=seed, noise=REALISTIC)
        found = []
        for number in range(ROBOTS):
            place = Pose((0.0, 2.0 * number, 0.0))
            entity = simulation.add_robot(f"p{number}", f"p{number}", robot, place)
            entity.drives[0].command(simulation.moment, 0.5, 0.0)
            found.append(entity)
        simulation.advance(simulation.tick + 1200)
        return [
            (motion.speed, motion.turn)
            for motion in (entity.drives[0].drive.odometry for entity in found)
        ]

    first = rates(1)
    assert first == rates(1)
    assert first != rates(2)
    speeds = np.array([speed for speed, _ in first])
    # The mean of two wheels.
    assert (speeds / 0.5).std() == pytest.approx(0.005 / np.sqrt(2.0), rel=0.5)


def test_profiles_have_the_names_that_scenarios_use() -> None:
    assert list(PROFILES) == ["described", "realistic"]
