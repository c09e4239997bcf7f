"""Engine-independent behaviour of the simulation: order, time, names, wrenches."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fake_engine import FakeEngine

from pioneer_gazebo.body.body import body_from_robot, lowest_points
from pioneer_gazebo.error import BoundError, ModelError
from pioneer_gazebo.physics.engine import Engine, EngineError, Physics, Velocity
from pioneer_gazebo.simulation.actor import Wrench
from pioneer_gazebo.simulation.command import Moment
from pioneer_gazebo.simulation.drive import CommandError
from pioneer_gazebo.simulation.schedule import TICK_RATE, RateError
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.model import Collision, Cylinder, Link, Model, Sphere, World
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import DiffDrive, Robot


def no_mesh(mesh: object) -> None:
    raise AssertionError(f"no mesh is in this test: {mesh}")


@pytest.fixture
def engine() -> FakeEngine:
    return FakeEngine()


@pytest.fixture
def simulation(engine: FakeEngine) -> Simulation:
    checked: Engine = engine
    return Simulation(checked, no_mesh, Physics())


def test_the_engine_steps_only_as_far_as_time_needs(
    simulation: Simulation, engine: FakeEngine
) -> None:
    simulation.advance(1)
    simulation.advance(12)
    assert engine.steps == 1
    simulation.advance(13)
    assert engine.steps == 2


def test_a_physics_step_that_is_not_whole_ticks_is_refused(simulation: Simulation) -> None:
    with pytest.raises(RateError, match="the physics step"):
        simulation.configure(Physics(step=0.0123))


def test_odometry_on_wheels_that_never_slip_is_the_truth(
    simulation: Simulation, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "r", robot, Pose())
    entity.drives[0].drive.command(0.5, 0.5)
    for tick in (600, 1234, 2999):
        simulation.advance(tick)
        pose, odometry = simulation.pose(entity), simulation.odometry(entity.drives[0])
        assert pose.position[0] == pytest.approx(odometry.x, abs=1e-4)
        assert pose.position[1] == pytest.approx(odometry.y, abs=1e-4)


def test_a_robot_whose_drive_is_refused_leaves_nothing_behind(
    simulation: Simulation, robot: Robot
) -> None:
    devices = [
        replace(one, wheelDiameter=0.0) if isinstance(one, DiffDrive) else one
        for one in robot.devices
    ]
    with pytest.raises(CommandError, match="must be above 0"):
        simulation.add_robot("r", "r", replace(robot, devices=tuple(devices)), Pose())
    assert simulation.names() == []
    simulation.add_robot("r", "r", robot, Pose())


def test_fixed_joints_are_lumped_and_wheels_become_balls(robot: Robot) -> None:
    body = body_from_robot(robot, no_mesh)
    assert [part.name for part in body.parts] == [
        "base_link",
        "left_wheel",
        "right_wheel",
        "swivel",
        "caster",
    ]
    assert [name for name, _ in body.parts[0].frames] == ["base_link", "laser"]
    wheel = body.parts[1].touches[0]
    assert wheel.rolling
    assert wheel.collision.shape == Sphere(0.0975)
    drums = [
        touch for touch in body.parts[0].touches if isinstance(touch.collision.shape, Cylinder)
    ]
    assert len(drums) == 2
    assert min(z for *_, z in lowest_points(body, Pose(), no_mesh)) == pytest.approx(0.0)


def test_what_stands_in_the_ground_is_lifted_onto_it(simulation: Simulation, robot: Robot) -> None:
    entity = simulation.add_robot("r", "", robot, Pose((0.0, 0.0, -0.1)))
    assert entity.initial.position[2] == pytest.approx(0.0005)


def test_a_refused_robot_leaves_nothing(
    simulation: Simulation, engine: FakeEngine, robot: Robot
) -> None:
    engine.refuses = robot.name
    with pytest.raises(EngineError):
        simulation.add_robot("r", "", robot, Pose())
    assert simulation.names() == []


def test_low_shapes_are_ground_and_high_ones_obstacles(
    simulation: Simulation, engine: FakeEngine, box: Callable[..., Model]
) -> None:
    slab = box("slab", Pose((0.0, 0.0, -0.05)), (5.0, 5.0, 0.1))
    wall = box("wall", Pose((0.0, 0.0, 0.5)), (1.0, 0.1, 1.0))
    simulation.load(World("w", (slab, wall)))
    ground, obstacles = engine.standing
    assert [one.model.name for one in ground] == ["slab"]
    assert [one.model.name for one in obstacles] == ["wall"]


def test_only_robots_that_shall_stand_may_sleep(
    simulation: Simulation, engine: FakeEngine, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "", robot, Pose())
    simulation.advance(12)
    assert entity.handle in engine.resting
    entity.drives[0].drive.command(0.1, 0.0)
    simulation.advance(24)
    assert entity.handle not in engine.resting


def test_collisions_are_reported_once_an_episode(
    simulation: Simulation, engine: FakeEngine, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "", robot, Pose())
    engine.touched = {entity.handle}
    simulation.advance(120)
    assert [one.name for one in simulation.collided()] == ["r"]
    assert simulation.collided() == []
    engine.touched = set()
    simulation.advance(600)
    engine.touched = {entity.handle}
    simulation.advance(612)
    assert entity.collisions.count == 2


def test_a_wrench_acts_from_first_to_last_tick(
    simulation: Simulation, engine: FakeEngine, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "", robot, Pose())
    simulation.push(Wrench(entity, 0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 60, 120))
    simulation.advance(TICK_RATE)
    assert len(engine.pushed) == 5


@pytest.mark.parametrize("step", [1 / 600, 0.01, 0.02, 0.05])
@pytest.mark.parametrize("at", [0.0, 0.013, 0.2])
@pytest.mark.parametrize("duration", [0.001, 0.01, 0.02, 0.033, 0.1])
def test_the_impulse_of_a_wrench_is_force_times_duration_at_any_physics_step(
    simulation: Simulation,
    engine: FakeEngine,
    robot: Robot,
    step: float,
    at: float,
    duration: float,
) -> None:
    simulation.configure(Physics(step=step))
    entity = simulation.add_robot("r", "", robot, Pose())
    simulation.advance(7)
    first = at * TICK_RATE
    last = first + duration * TICK_RATE
    simulation.push(
        Wrench(entity, 0, (100.0, 0.0, 0.0), (0.0, 0.0, 4.0), (0.0, 0.0, 0.0), first, last)
    )
    simulation.advance(TICK_RATE)
    impulse = sum(force[0] for _, _, force, _, _ in engine.pushed) * step
    twist = sum(torque[2] for _, _, _, torque, _ in engine.pushed) * step
    assert impulse == pytest.approx(100.0 * duration)
    assert twist == pytest.approx(4.0 * duration)


def test_a_wrench_without_end_is_cleared_with_its_link(
    simulation: Simulation, engine: FakeEngine, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "", robot, Pose())
    simulation.push(
        Wrench(entity, 0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0, math.inf)
    )
    simulation.advance(120)
    simulation.clear_pushes(Wrench, entity, 0)
    count = len(engine.pushed)
    simulation.advance(240)
    assert len(engine.pushed) == count == 10


def test_a_static_model_is_not_an_entity_and_the_error_names_it(
    simulation: Simulation, box: Callable[..., Model]
) -> None:
    simulation.load(World("w", (box("wall", Pose((0.0, 0.0, 0.5)), (1.0, 0.1, 1.0)),)))
    with pytest.raises(ModelError, match="wall is static"):
        simulation.entity("wall")
    simulation.place("wall", Pose((1.0, 0.0, 0.5)))
    assert simulation.standing["wall"].pose.position == (1.0, 0.0, 0.5)
    simulation.reset_poses()
    assert simulation.standing["wall"].pose.position == (0.0, 0.0, 0.5)


def test_a_command_acts_from_the_first_step_that_begins_after_it_however_late_that_is_worked_out(
    simulation: Simulation, robot: Robot
) -> None:
    driven = simulation.add_robot("r", "r", robot, Pose()).drives[0]
    driven.command(Moment(0, 0), 1.0, 0.0)
    driven.command(Moment(0, 13), 0.0, 0.0)
    simulation.advance(24)
    moving = simulation.odometry(driven).speed
    assert moving > 0.1
    simulation.advance(36)
    assert 0.0 < simulation.odometry(driven).speed < moving
    with pytest.raises(CommandError):
        driven.command(Moment(0, 40), math.nan, 0.0)


def test_a_reset_forgets_commands_that_were_not_obeyed_yet(
    simulation: Simulation, robot: Robot
) -> None:
    driven = simulation.add_robot("r", "r", robot, Pose()).drives[0]
    driven.command(Moment(0, 600), 1.0, 0.0)
    simulation.reset()
    simulation.advance(1200)
    assert simulation.odometry(driven).x == 0.0


def test_between_two_steps_poses_lie_between_their_states(
    simulation: Simulation, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "r", robot, Pose())
    entity.drives[0].command(Moment(0, 0), 1.0, 0.0)
    at = {}
    for tick in (600, 606, 612):
        simulation.advance(tick)
        at[tick] = simulation.pose(entity).position[0]
    assert at[606] == pytest.approx((at[600] + at[612]) / 2)


def test_numbers_that_no_engine_can_simulate_are_refused(
    simulation: Simulation, robot: Robot
) -> None:
    entity = simulation.add_robot("r", "r", robot, Pose())
    huge, still = 1e200, (0.0, 0.0, 0.0)
    with pytest.raises(BoundError, match="velocity must be finite and at most 1000 m/s"):
        simulation.place("r", Pose(), Velocity((huge, 0.0, 0.0)))
    with pytest.raises(BoundError, match="position"):
        simulation.place("r", Pose((huge, 0.0, 0.0)))
    with pytest.raises(BoundError, match="force"):
        simulation.push(Wrench(entity, 0, (math.nan, 0.0, 0.0), still, still, 0, 10))
    with pytest.raises(BoundError, match="joint position"):
        simulation.set_joint(entity, "left_joint", math.inf)
    for physics in (Physics(gravity=(0.0, 0.0, -huge)), Physics(iterations=10**9)):
        with pytest.raises(BoundError):
            simulation.configure(physics)
    for link in (
        Link("l", mass=huge),
        Link("l", collisions=(Collision("c", Pose(), Sphere(huge)),)),
    ):
        for static in (False, True)[: 1 if link.mass == huge else 2]:
            with pytest.raises(BoundError, match="m, link"):
                simulation.add_model(Model("m", static=static, links=(link,)))
    with pytest.raises(CommandError, match="at most 100 m/s"):
        entity.drives[0].command(Moment(0, 0), 1e6, 0.0)
    assert simulation.names() == ["r"]


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e200])
def test_a_body_that_flies_out_of_the_world_is_found_and_the_others_stay(
    simulation: Simulation, engine: FakeEngine, robot: Robot, bad: float
) -> None:
    entities = [simulation.add_robot(name, name, robot, Pose()) for name in ("good", "bad")]
    engine.set_pose(entities[1].handle, Pose((0.0, bad, 0.0)))
    simulation.advance(2 * TICK_RATE)
    assert math.isfinite(simulation.pose(entities[1]).position[1])
    assert np.isfinite(simulation.ranges(entities[0], entities[0].lasers[0])).any()
    assert simulation.lost() == ["bad"]
    simulation.remove("bad")
    assert simulation.lost() == []
