"""Robots on the real engine among walls, boxes and each other.

``pioneer_bench``'s test_accuracy checks how accurately they follow commands and stand still.
"""

import math
from collections.abc import Callable

import numpy as np
import pytest

from pioneer_gazebo.error import ModelError
from pioneer_gazebo.physics.engine import STILL
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.model import Model
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot

MakeSimulation = Callable[..., Simulation]
MakeBox = Callable[..., Model]


def run(simulation: Simulation, seconds: float) -> None:
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


def drive(entity: Entity, speed: float, turn: float) -> None:
    entity.drives[0].drive.command(speed, turn)


def settled(
    simulation: Simulation, robot: Robot, name: str = "r", pose: Pose | None = None
) -> Entity:
    entity = simulation.add_robot(name, name, robot, pose or Pose())
    run(simulation, 1.0)
    return entity


def test_a_sleeping_robot_wakes_at_the_next_command(simulate: MakeSimulation, robot: Robot) -> None:
    simulation = simulate()
    entity = settled(simulation, robot)
    run(simulation, 5.0)
    drive(entity, 0.5, 0.0)
    run(simulation, 2.0)
    assert simulation.pose(entity).position[0] > 0.8


def test_a_wall_that_stops_a_robot_is_touched_once_and_named(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    simulation = simulate(box("wall", Pose((2.0, 0.0, 0.5)), (0.1, 6.0, 1.0)))
    entity = settled(simulation, robot)
    drive(entity, 1.2, 0.0)
    run(simulation, 6.0)
    assert entity.collisions.count == 1
    assert simulation.touched_name(simulation.contacts(entity)[0]) == "wall::link::collision"


def test_two_robots_stop_each_other_and_both_count_it(
    simulate: MakeSimulation, robot: Robot
) -> None:
    simulation = simulate()
    one = settled(simulation, robot, "one")
    other = settled(simulation, robot, "other", Pose.from_rpy(1.5, yaw=math.pi))
    drive(one, 0.5, 0.0)
    drive(other, 0.5, 0.0)
    run(simulation, 4.0)
    gap = simulation.pose(other).position[0] - simulation.pose(one).position[0]
    assert gap > 0.33
    assert (one.collisions.count, other.collisions.count) == (1, 1)
    assert {entity.name for entity in simulation.collided()} == {"one", "other"}


def test_a_parked_robot_is_pushed_by_another(simulate: MakeSimulation, robot: Robot) -> None:
    simulation = simulate()
    pusher = settled(simulation, robot, "pusher")
    parked = settled(simulation, robot, "parked", Pose((1.0, 0.0, 0.0)))
    run(simulation, 5.0)
    before = simulation.pose(parked).position[0]
    drive(pusher, 0.8, 0.0)
    run(simulation, 5.0)
    assert simulation.pose(parked).position[0] > before + 0.02


def test_a_loose_box_is_pushed_and_seen_where_it_went(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    simulation = simulate(box("crate", Pose((1.5, 0.0, 0.2)), (0.4, 0.4, 0.4), False, 1.0))
    entity = settled(simulation, robot)
    before = simulation.ranges(entity, entity.lasers[0])[45]
    assert before == pytest.approx(1.3 - 0.08, abs=0.05)
    drive(entity, 0.5, 0.0)
    run(simulation, 5.0)
    crate = simulation.entity("crate")
    assert simulation.pose(crate).position[0] > 2.0


def record(simulation: Simulation, robot: Robot) -> list[float]:
    """Lets two robots drive and scan; returns everything that they report."""
    entities = [
        settled(simulation, robot, name, Pose((0.0, k * 2.0, 0.0))) for k, name in enumerate("ab")
    ]
    for k, entity in enumerate(entities):
        drive(entity, 0.5, 0.3 - 0.5 * k)
    values: list[float] = []
    for _ in range(30):
        run(simulation, 0.05)
        for entity in entities:
            values += [*simulation.pose(entity).position, *simulation.pose(entity).rotation]
            odometry = simulation.odometry(entity.drives[0])
            values += [odometry.x, odometry.y, odometry.yaw]
            values += simulation.ranges(entity, entity.lasers[0]).tolist()
    return values


def test_the_same_seed_and_commands_give_the_same_bits(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    wall = box("wall", Pose((3.0, 0.0, 0.5)), (0.1, 6.0, 1.0))
    first, again, other = (
        record(simulate(wall, seed=seed, odometry_error=0.01), robot) for seed in (3, 3, 4)
    )
    assert first == again
    assert first != other


def test_encoders_that_overrate_every_wheel_see_the_same_part_more_of_ways_and_turns(
    simulate: MakeSimulation, robot: Robot
) -> None:
    odometry = []
    for scale in (1.0, 1.03):
        simulation = simulate(odometry_scale=scale)
        entity = settled(simulation, robot)
        drive(entity, 0.5, 0.3)
        run(simulation, 2.0)
        odometry.append(simulation.odometry(entity.drives[0]))
    true, overrated = odometry
    assert overrated.speed == pytest.approx(1.03 * true.speed)
    assert overrated.yaw == pytest.approx(1.03 * true.yaw)


def test_adding_a_robot_changes_no_noise_of_the_others(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    wall = box("wall", Pose((3.0, 0.0, 0.5)), (0.1, 6.0, 1.0))
    alone, together = simulate(wall, seed=5), simulate(wall, seed=5)
    settled(together, robot, "b", Pose((-3.0, 0.0, 0.0)))
    together.reset()
    scans = []
    for simulation in (alone, together):
        entity = simulation.add_robot("a", "a", robot, Pose())
        scans.append(simulation.ranges(entity, entity.lasers[0]).copy())
    np.testing.assert_array_equal(*scans)


def test_between_two_steps_a_pose_lies_between_their_poses(
    simulate: MakeSimulation, robot: Robot
) -> None:
    simulation = simulate()
    entity = settled(simulation, robot)
    drive(entity, 1.0, 0.0)
    run(simulation, 1.0)
    a = simulation.pose(entity).position[0]
    simulation.advance(simulation.tick + 6)
    b = simulation.pose(entity).position[0]
    simulation.advance(simulation.tick + 6)
    c = simulation.pose(entity).position[0]
    assert a < b < c
    assert b - a == pytest.approx(c - b, rel=1e-6)


def test_spawning_into_a_wall_is_refused_and_leaves_nothing(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    simulation = simulate(box("wall", Pose((0.0, 0.0, 0.5)), (3.0, 3.0, 1.0)))
    with pytest.raises(
        ModelError, match=r"r at \(0.00, 0.00\) would overlap wall::link::collision by"
    ):
        simulation.add_robot("r", "", robot, Pose())
    assert simulation.names() == ["floor", "wall"]


def test_a_robot_spawned_a_little_inside_a_wall_is_moved_to_the_nearest_free_pose(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    simulation = simulate(box("wall", Pose((1.0, 0.0, 0.5)), (2.0, 2.0, 1.0)))
    entity = simulation.add_robot("r", "r", robot, Pose())
    x, y, _ = entity.initial.position
    assert x < -0.15
    assert math.hypot(x, y) <= 0.301
    run(simulation, 2.0)
    assert entity.collisions.count == 0
    with pytest.raises(ModelError, match="would overlap r::"):
        simulation.add_robot("other", "o", robot, entity.initial)


def test_a_wheel_is_as_wide_as_described_beside_a_wall(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    face = 0.165 + 0.04 / 2 + 0.01
    simulation = simulate(box("wall", Pose((0.0, face + 0.05, 0.5)), (4.0, 0.1, 1.0)))
    entity = settled(simulation, robot)
    drive(entity, 0.3, 0.0)
    run(simulation, 2.0)
    assert entity.collisions.count == 0


def test_a_name_that_is_taken_is_refused(simulate: MakeSimulation, robot: Robot) -> None:
    simulation = simulate()
    simulation.add_robot("r", "", robot, Pose())
    with pytest.raises(ModelError, match="already exists"):
        simulation.add_robot("r", "", robot, Pose((3.0, 0.0, 0.0)))
    with pytest.raises(ModelError, match="1 to 200 characters"):
        simulation.add_robot("r" * 1_000_000, "", robot, Pose((3.0, 0.0, 0.0)))


def test_a_robot_can_be_removed_while_it_drives(simulate: MakeSimulation, robot: Robot) -> None:
    simulation = simulate()
    one = settled(simulation, robot, "one")
    settled(simulation, robot, "two", Pose((2.0, 0.0, 0.0)))
    drive(one, 0.5, 0.0)
    run(simulation, 0.5)
    simulation.remove("one")
    run(simulation, 0.5)
    assert simulation.names() == ["floor", "two"]
    drive(one, 0.5, 0.0)
    with pytest.raises(ModelError, match="one does not exist"):
        simulation.entity("one")


def test_resetting_poses_leaves_time_and_resetting_all_does_not(
    simulate: MakeSimulation, robot: Robot
) -> None:
    simulation = simulate()
    entity = settled(simulation, robot)
    drive(entity, 0.5, 0.5)
    run(simulation, 2.0)
    tick = simulation.tick
    simulation.reset_poses()
    assert simulation.tick == tick
    assert math.dist(simulation.pose(entity).position, entity.initial.position) < 1e-9
    assert simulation.odometry(entity.drives[0]).x == 0.0
    run(simulation, 2.0)
    assert math.dist(simulation.pose(entity).position, entity.initial.position) < 0.01
    simulation.reset()
    assert simulation.tick == 0


def test_a_robot_can_be_put_elsewhere_and_stops_there(
    simulate: MakeSimulation, robot: Robot
) -> None:
    simulation = simulate()
    entity = settled(simulation, robot)
    simulation.place("r", Pose.from_rpy(4.0, -2.0, 0.001, yaw=1.0), STILL)
    run(simulation, 1.0)
    pose = simulation.pose(entity)
    assert math.dist(pose.position[:2], (4.0, -2.0)) < 0.01
    assert pose.yaw == pytest.approx(1.0, abs=0.02)


def test_a_world_of_a_thousand_boxes_stands_and_is_seen(
    simulate: MakeSimulation, robot: Robot, box: MakeBox
) -> None:
    rng = np.random.default_rng(1)
    places = [p for p in rng.uniform(-40, 40, (1100, 2)) if np.hypot(*p) > 1.5][:1000]
    boxes = [
        box(f"b{k}", Pose.from_rpy(*p, 0.5, yaw=k), (1.0, 0.2, 1.0)) for k, p in enumerate(places)
    ]
    simulation = simulate(*boxes)
    entity = settled(simulation, robot)
    assert np.isfinite(simulation.ranges(entity, entity.lasers[0])).any()
    simulation.remove("b7")
    assert "b7" not in simulation.names()
