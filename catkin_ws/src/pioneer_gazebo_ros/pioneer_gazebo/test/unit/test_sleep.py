"""Bodies that sleep in the engine wake when what carries them goes away, and when they are moved."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from pioneer_gazebo.physics.engine import Physics, Velocity
from pioneer_gazebo.simulation.actor import Wrench
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.model import Inertia, Model
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot

MakeSimulation = Callable[..., Simulation]

ASLEEP = 5 * TICK_RATE
"""Long enough for every motionless body to fall asleep [ticks]."""

TOP = 1.0
"""Height of the table [m]."""

FAR = Pose((30.0, 0.0, TOP / 2))


def laid(
    simulate: MakeSimulation, box: Callable[..., Model], robot: Robot, static: bool
) -> Simulation:
    """Returns a world with two boxes, one on the other, and a robot, all asleep on a table."""
    table = box("table", Pose((0.0, 0.0, TOP / 2)), (4.0, 4.0, TOP), static=static, mass=500.0)
    # Otherwise it would rock under the robot.
    table = replace(table, links=(replace(table.links[0], inertia=Inertia(700.0, 700.0, 1300.0)),))
    lower = box("lower", Pose((-1.0, 0.0, TOP + 0.1)), (0.2, 0.2, 0.2), static=False)
    upper = box("upper", Pose((-1.0, 0.0, TOP + 0.3)), (0.2, 0.2, 0.2), static=False)
    simulation = simulate(table, lower, upper)
    simulation.add_robot("r", "r", robot, Pose((1.0, 0.0, TOP)))
    simulation.advance(ASLEEP)
    assert height(simulation, "upper") == pytest.approx(TOP + 0.3, abs=0.01)
    assert height(simulation, "r") == pytest.approx(TOP, abs=0.01)
    return simulation


def height(simulation: Simulation, name: str) -> float:
    return simulation.pose(simulation.entity(name)).position[2]


def assert_fallen(simulation: Simulation) -> None:
    simulation.advance(simulation.tick + 2 * TICK_RATE)
    for name in ("lower", "upper", "r"):
        assert height(simulation, name) < 0.5, f"{name} floats"


@pytest.mark.parametrize("static", [False, True])
def test_what_sleeps_on_a_table_falls_when_the_table_is_removed(
    simulate: MakeSimulation, box: Callable[..., Model], robot: Robot, static: bool
) -> None:
    simulation = laid(simulate, box, robot, static)
    simulation.remove("table")
    assert_fallen(simulation)


@pytest.mark.parametrize("static", [False, True])
def test_what_sleeps_on_a_table_falls_when_the_table_is_moved(
    simulate: MakeSimulation, box: Callable[..., Model], robot: Robot, static: bool
) -> None:
    simulation = laid(simulate, box, robot, static)
    simulation.place("table", FAR)
    assert_fallen(simulation)


def test_what_sleeps_rises_when_gravity_is_turned_round(
    simulate: MakeSimulation, box: Callable[..., Model], robot: Robot
) -> None:
    simulation = laid(simulate, box, robot, True)
    simulation.configure(replace(simulation.physics, gravity=(0.0, 0.0, 2.0)))
    simulation.advance(simulation.tick + 2 * TICK_RATE)
    for name in ("lower", "upper", "r"):
        assert height(simulation, name) > TOP + 1.0, f"{name} stays down"


def test_a_distant_robot_sleeps_on(
    simulate: MakeSimulation, box: Callable[..., Model], robot: Robot
) -> None:
    simulation = laid(simulate, box, robot, True)
    sleeping = simulation.add_robot("far", "far", robot, Pose((8.0, 0.0, 0.0)))
    simulation.advance(simulation.tick + ASLEEP)
    before = simulation.pose(sleeping)
    simulation.place("lower", Pose((3.0, 0.0, 0.1)))
    simulation.remove("upper")
    simulation.advance(simulation.tick + TICK_RATE)
    assert simulation.pose(sleeping) == before


WEIGHTLESS = Physics(gravity=(0.0, 0.0, 0.0))
STEPS = (1 / 600, 0.01, 0.02, 0.05)


def motion(simulation: Simulation, ticks: int = TICK_RATE // 2) -> list[Pose]:
    """Returns the poses of the box ``b`` at each step from now on."""
    entity, begin = simulation.entity("b"), simulation.tick
    poses = []
    while simulation.tick < begin + ticks:
        simulation.advance(simulation.tick + round(simulation.physics.step * TICK_RATE))
        poses.append(simulation.pose(entity))
    return poses


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize("spin", [0.0, 0.7])
def test_a_sleeping_body_that_is_placed_with_a_velocity_moves_as_one_that_is_awake(
    simulate: MakeSimulation,
    box: Callable[..., Model],
    step: float,
    gravity: float,
    spin: float,
) -> None:
    runs = []
    for asleep in (True, False):
        simulation = simulate()
        simulation.configure(Physics(step, gravity=(0.0, 0.0, gravity)))
        simulation.add_model(box("b", Pose((0.0, 0.0, 0.1)), (0.2, 0.2, 0.2), static=False))
        simulation.advance(ASLEEP if asleep else 0)
        velocity = Velocity((1.0, -0.5, 0.3), (0.0, 0.0, spin))
        simulation.place("b", Pose((2.0, 1.0, 5.0)), velocity)
        runs.append(motion(simulation))
    for sleeper, other in zip(*runs, strict=True):
        assert sleeper.position == pytest.approx(other.position, abs=1e-3)
        assert sleeper.yaw == pytest.approx(other.yaw, abs=1e-3)


@pytest.mark.parametrize("step", STEPS)
def test_a_sleeping_body_gets_the_impulse_of_a_wrench(
    simulate: MakeSimulation, box: Callable[..., Model], step: float
) -> None:
    simulation = simulate()
    simulation.configure(replace(WEIGHTLESS, step=step))
    simulation.add_model(box("b", Pose((0.0, 0.0, 5.0)), (0.2, 0.2, 0.2), static=False))
    simulation.advance(ASLEEP)
    entity, first = simulation.entity("b"), simulation.tick
    nothing = (0.0, 0.0, 0.0)
    force, last = (100.0, 0.0, 0.0), first + 0.01 * TICK_RATE
    simulation.push(Wrench(entity, 0, force, nothing, None, first, last))
    motion(simulation)
    assert simulation.velocity(entity).linear == pytest.approx((1.0, 0.0, 0.0), abs=0.03)


def asleep_in_space(simulate: MakeSimulation, box: Callable[..., Model]) -> Simulation:
    """Returns a simulation of the box ``b``, of 1 kg, which has fallen asleep without gravity."""
    simulation = simulate()
    simulation.configure(replace(WEIGHTLESS, step=0.01))
    simulation.add_model(box("b", Pose((0.0, 0.0, 5.0)), (0.2, 0.2, 0.2), static=False))
    simulation.advance(ASLEEP)
    return simulation


def push_for_a_step(simulation: Simulation) -> None:
    nothing, first = (0.0, 0.0, 0.0), simulation.tick
    last = first + 0.01 * TICK_RATE
    entity = simulation.entity("b")
    simulation.push(Wrench(entity, 0, (100.0, 0.0, 0.0), nothing, None, first, last))


def test_a_reset_ends_the_push_of_a_body_that_was_asleep(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    """The push acts a step late, and once acted after the reset."""
    simulation = asleep_in_space(simulate, box)
    push_for_a_step(simulation)
    simulation.advance(simulation.tick + round(0.01 * TICK_RATE))
    simulation.reset_poses()
    motion(simulation)
    assert simulation.velocity(simulation.entity("b")).linear == (0.0, 0.0, 0.0)


def test_a_sleeping_body_gets_both_a_velocity_and_an_impulse_of_one_step(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    simulation = asleep_in_space(simulate, box)
    push_for_a_step(simulation)
    simulation.place("b", Pose((0.0, 0.0, 5.0)), Velocity((0.0, 1.0, 0.0)))
    motion(simulation)
    moves = simulation.velocity(simulation.entity("b")).linear
    assert moves == pytest.approx((1.0, 1.0, 0.0), abs=0.03)


def test_a_sleeping_body_on_the_ground_that_gets_a_velocity_slides(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    simulation = simulate(box("b", Pose((0.0, 0.0, 0.1)), (0.2, 0.2, 0.2), static=False))
    simulation.advance(ASLEEP)
    simulation.place("b", simulation.pose(simulation.entity("b")), Velocity((1.0, 0.0, 0.0)))
    poses = motion(simulation)
    assert poses[-1].position[0] > 0.03
    assert all(pose.position[2] == pytest.approx(0.1, abs=0.005) for pose in poses)
