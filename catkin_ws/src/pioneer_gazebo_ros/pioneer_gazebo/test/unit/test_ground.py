"""Third-party robots and what they stand and drive on: mesh wheels, thick floors, platforms, ramps."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from pioneer_gazebo.physics.engine import STILL
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.model import Collision, Link, Mesh, Model
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot

MakeSimulation = Callable[..., Simulation]
MakeBox = Callable[..., Model]


def run(simulation: Simulation, seconds: float) -> None:
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


def drive_for(
    simulation: Simulation, entity: Entity, seconds: float, speed: float, turn: float = 0.0
) -> Pose:
    run(simulation, 1.0)
    entity.drives[0].drive.command(speed, turn)
    run(simulation, seconds)
    entity.drives[0].drive.command(0.0, 0.0)
    run(simulation, 1.0)
    return simulation.pose(entity)


def test_two_meshes_on_a_wheel_leave_the_other_wheel_driven(
    simulate: MakeSimulation, mesh_robot: Robot
) -> None:
    simulation = simulate()
    entity = simulation.add_robot("r", "r", mesh_robot, Pose((0.0, 0.0, 0.135)))
    pose = drive_for(simulation, entity, 3.0, 0.2)
    roll, pitch, yaw = pose.rpy()
    assert pose.position[0] == pytest.approx(0.6, abs=0.005)
    assert pose.position[1] == pytest.approx(0.0, abs=0.005)
    assert max(abs(roll), abs(pitch), abs(yaw)) < 0.005
    pose = drive_for(simulation, entity, math.pi, 0.0, 0.5)
    assert pose.yaw == pytest.approx(math.pi / 2, abs=0.02)


def floor_box(box: MakeBox, top: float, size: float = 10.0) -> Model:
    return box("asphalt", Pose((0.0, 0.0, top - 0.05)), (size, size, 0.1))


def test_a_robot_spawned_in_a_thick_floor_lands_on_it_and_drives(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    simulation = simulate(floor_box(box, 0.05))
    entity = simulation.add_robot("r", "r", robot, Pose())
    pose = drive_for(simulation, entity, 4.0, 0.3)
    assert pose.position[2] == pytest.approx(0.05, abs=0.003)
    assert pose.position[0] == pytest.approx(1.2, abs=0.01)
    assert simulation.odometry(entity.drives[0]).x == pytest.approx(pose.position[0], abs=0.01)
    assert entity.collisions.count == 0


def test_a_robot_drives_on_a_platform_and_beside_it(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    face = 0.185 + 0.01
    simulation = simulate(box("platform", Pose((0.0, face + 1.0, 0.25)), (6.0, 2.0, 0.5)))
    beside = simulation.add_robot("beside", "b", robot, Pose((-1.0, 0.0, 0.0)))
    above = simulation.add_robot("above", "a", robot, Pose((-1.0, face + 1.0, 0.5)))
    for entity in (beside, above):
        entity.drives[0].drive.command(0.3, 0.0)
    run(simulation, 4.0)
    assert simulation.pose(beside).position[0] > 0.15
    assert simulation.pose(above).position[0] > 0.15
    assert simulation.pose(above).position[2] == pytest.approx(0.5, abs=0.003)
    assert (beside.collisions.count, above.collisions.count) == (0, 0)


def test_a_robot_climbs_a_ramp(simulate: MakeSimulation, robot: Robot, box: MakeBox) -> None:
    slope = 0.1
    ramp = box(
        "ramp", Pose.from_rpy(3.0, 0.0, 2.0 * math.sin(slope) - 0.05, pitch=-slope), (4.0, 2.0, 0.1)
    )
    simulation = simulate(ramp)
    entity = simulation.add_robot("r", "r", robot, Pose())
    pose = drive_for(simulation, entity, 10.0, 0.3)
    assert pose.position[2] == pytest.approx((pose.position[0] - 1.0) * math.tan(slope), abs=0.04)
    assert -pose.rpy()[1] == pytest.approx(slope, abs=0.02)


def test_a_robot_stands_and_drives_on_a_mesh(
    simulate: MakeSimulation, robot: Robot, tmp_path: Path
) -> None:
    path = tmp_path / "floor.obj"
    path.write_text("v -5 -5 0.2\nv 5 -5 0.2\nv 5 5 0.2\nv -5 5 0.2\nv 2 -5 0.2\nv 2 5 0.2\nv 2 -5 1\nv 2 5 1\n"
                    "f 1 2 3\nf 1 3 4\nf 5 6 8\nf 5 8 7\n")  # fmt: skip
    link = Link("l", collisions=(Collision("c", Pose(), Mesh(str(path))),))
    simulation = simulate(Model("hall", static=True, links=(link,)))
    entity = simulation.add_robot("r", "r", robot, Pose())
    assert drive_for(simulation, entity, 3.0, 0.3).position[0] == pytest.approx(0.9, abs=0.02)
    assert simulation.pose(entity).position[2] == pytest.approx(0.2, abs=0.003)
    drive_for(simulation, entity, 4.0, 0.5)
    assert entity.collisions.count == 1
    assert simulation.pose(entity).position[0] < 2.0


def test_two_places_of_one_mesh_carry_robots_also_after_other_models_came_and_went(
    simulate: MakeSimulation, robot: Robot, box: MakeBox, tmp_path: Path
) -> None:
    path = tmp_path / "table.obj"
    path.write_text("v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3 4\n")
    link = Link("l", collisions=(Collision("c", Pose(), Mesh(str(path))),))
    places = [Pose.from_rpy(0.0, 0.0, 0.3), Pose.from_rpy(10.0, 0.0, 0.6, yaw=0.7)]
    simulation = simulate(*(Model(f"table_{k}", at, True, (link,)) for k, at in enumerate(places)))
    for name in ("a", "b"):
        simulation.add_model(box(name, Pose((5.0, 0.0, 0.5)), (1.0, 1.0, 1.0)))
        simulation.remove(name)
    simulation.remove("table_0")
    entities = [simulation.add_robot(f"r{k}", f"r{k}", robot, at) for k, at in enumerate(places)]
    run(simulation, 1.0)
    heights = [simulation.pose(entity).position[2] for entity in entities]
    assert heights == pytest.approx([0.0, 0.6], abs=0.003)


def test_a_robot_set_above_a_floor_falls_on_it(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    simulation = simulate(floor_box(box, 0.2))
    entity = simulation.add_robot("r", "r", robot, Pose((0.0, 0.0, 0.3)))
    run(simulation, 2.0)
    assert simulation.pose(entity).position[2] == pytest.approx(0.2, abs=0.003)
    simulation.place("r", Pose((1.0, 0.0, 0.3)), STILL)
    run(simulation, 2.0)
    assert simulation.pose(entity).position[2] == pytest.approx(0.2, abs=0.003)
