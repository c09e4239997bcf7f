"""The same seed, world and commands give the same bits, at any speed and for any split of time into steps."""

import hashlib
from collections.abc import Callable, Iterator
from itertools import cycle

import numpy as np
import pytest

from pioneer_gazebo.simulation.schedule import TICK_RATE, Schedule
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import Pacer
from pioneer_gazebo.world.joint import CONTINUOUS, WORLD, Joint
from pioneer_gazebo.world.model import (
    Box,
    Collision,
    Cylinder,
    Link,
    Model,
    Script,
    Trajectory,
    Waypoint,
)
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot

MakeSimulation = Callable[..., Simulation]

COMMANDS = {300: (0.6, 0.4), 900: (0.0, -1.5), 1512: (0.9, 0.0), 2400: (-0.3, 0.7)}
"""The commands of both robots, by tick; they lead to the walls and to each other."""

END = 6 * TICK_RATE


def digest(simulation: Simulation, robot: Robot, pieces: Iterator[int]) -> str:
    """Runs six seconds in ``pieces`` [ticks]; returns a digest of everything that two robots report."""
    entities = [
        simulation.add_robot(name, name, robot, Pose.from_rpy(0.9 * k, yaw=2.0 * k))
        for k, name in enumerate("ab")
    ]
    found = hashlib.sha256()
    schedule = Schedule()

    def command(tick: int) -> None:
        for sign, entity in zip((1, -1), entities, strict=True):
            if tick in COMMANDS:
                speed, turn = COMMANDS[tick]
                entity.drives[0].drive.command(speed, sign * turn)

    def report(tick: int) -> None:
        for entity in entities:
            odometry = simulation.odometry(entity.drives[0])
            pose, velocity = simulation.pose(entity), simulation.velocity(entity)
            numbers = [
                *pose.position,
                *pose.rotation,
                *velocity.linear,
                odometry.x,
                odometry.y,
                odometry.yaw,
            ]
            found.update(np.array([tick, *numbers]).tobytes())
            if tick % 60 == 0:
                found.update(simulation.ranges(entity, entity.lasers[0]).tobytes())

    schedule.add("commands", 50, command)
    schedule.add("reports", 50, report)
    while simulation.tick < END:
        due = schedule.next_after(simulation.tick)
        # Time may stop anywhere before the next due task, as it does at other rates and in single steps.
        simulation.advance(min(due, simulation.tick + next(pieces)))
        if simulation.tick == due:
            for task in schedule.due(due):
                task.action(due)
    found.update(bytes([entity.collisions.count for entity in entities]))
    assert any(entity.collisions.count for entity in entities), "the run was to hold a collision"
    return found.hexdigest()


@pytest.mark.parametrize("pieces", [(1,), (12,), (5, 7, 1), (END,)])
def test_two_robots_report_the_same_bits_however_time_is_cut(
    simulate: MakeSimulation, robot: Robot, box: Callable[..., Model], pieces: tuple[int, ...]
) -> None:
    walls = [box(f"w{k}", Pose((2.5 * (-1) ** k, 0.0, 0.5)), (0.1, 6.0, 1.0)) for k in range(2)]
    reference = digest(simulate(*walls, seed=3, odometry_error=0.01), robot, cycle((6,)))
    assert digest(simulate(*walls, seed=3, odometry_error=0.01), robot, cycle(pieces)) == reference


@pytest.mark.parametrize("pieces", [(1,), (5, 7, 1), (END,)])
def test_the_same_bits_come_with_a_walking_person_and_a_swinging_door(
    simulate: MakeSimulation, robot: Robot, pieces: tuple[int, ...]
) -> None:
    collision = Collision("c", Pose((0.0, 0.0, 0.9)), Cylinder(0.25, 1.8))
    way = Trajectory((Waypoint(0.0, Pose((-2.0, 0.1, 0.0))), Waypoint(5.0, Pose((2.0, -0.1, 0.0)))))
    person = Model(
        "person", links=(Link("l", collisions=(collision,)),), script=Script((way,), Pose())
    )
    hinge = Joint(
        "hinge", CONTINUOUS, WORLD, "leaf", Pose((0.0, 0.5, 0.5)), (0.0, 0.0, 1.0), friction=0.1
    )
    leaf = Link(
        "leaf",
        Pose((0.0, 0.5, 0.5)),
        2.0,
        collisions=(Collision("c", Pose(), Box((1.0, 0.1, 0.9))),),
    )
    door = Model("door", Pose((0.5, 1.0, 0.0)), links=(leaf,), joints=(hinge,))
    reference = digest(simulate(person, door, seed=3), robot, cycle((6,)))
    assert digest(simulate(person, door, seed=3), robot, cycle(pieces)) == reference


def test_the_real_time_factor_decides_when_a_tick_comes_and_never_which() -> None:
    schedule = Schedule()
    schedule.add("clock", 100, lambda tick: None)
    schedule.add("odometry", 50, lambda tick: None)
    came = []
    for factor in (0.0, 1.0, 1e6):
        pacer, tick, ticks = Pacer(factor), 0, []
        while tick < 60:
            tick = schedule.next_after(tick)
            pacer.wait_for(tick / TICK_RATE)
            ticks.append(tick)
        came.append(ticks)
    assert came[0] == came[1] == came[2]
