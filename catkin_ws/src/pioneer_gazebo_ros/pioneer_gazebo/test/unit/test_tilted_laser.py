"""Lasers that are upside down, tilted, or tilted by a joint, see what is in the plane of their beams."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pybullet
import pytest
from conftest import MakeSimulation, write_drum

from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.model import Box, Collision, Cylinder, Link, Mesh, Model, Shape, Sphere
from pioneer_gazebo.world.pose import Pose, rotated
from pioneer_gazebo.world.robot import Robot
from pioneer_gazebo.world.urdf import robot_from_urdf

REACH = 8.0
ROBOT = """<robot name="r"><link name="base"><inertial><mass value="5"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
<link name="eye"><inertial><mass value="0.01"/>
<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="neck" type="{kind}"><origin xyz="0 0 0.3" rpy="{rpy}"/><parent link="base"/><child link="eye"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
<gazebo reference="eye"><sensor type="ray" name="scan"><ray><scan><horizontal><samples>181</samples>
<min_angle>-1.5707963</min_angle><max_angle>1.5707963</max_angle></horizontal></scan>
<range><min>0.01</min><max>8.0</max></range></ray>
<plugin name="p" filename="libgazebo_ros_laser.so"><topicName>scan</topicName></plugin></sensor></gazebo></robot>"""


def robot_with_laser(rpy: tuple[float, float, float], kind: str = "fixed") -> Robot:
    return robot_from_urdf(ROBOT.format(kind=kind, rpy=" ".join(map(str, rpy))))


def scan(simulation: Simulation, entity: Entity) -> np.ndarray:
    return simulation.ranges(entity, entity.lasers[0]).copy()


def test_a_laser_upside_down_does_not_swap_left_and_right(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    simulation = simulate(box("left", Pose((0.0, 3.0, 0.5)), (1.0, 0.2, 1.0)))
    moving = box("right", Pose((0.0, -2.0, 0.5)), (1.0, 0.2, 1.0), static=False)
    simulation.add_model(moving)
    upright = simulation.add_robot("a", "a", robot_with_laser((0, 0, 0)), Pose((0, 0, 0.1)))
    expected = scan(simulation, upright)
    assert expected[[0, -1]] == pytest.approx([1.9, 2.9], abs=1e-3)
    simulation.remove("a")
    turned = simulation.add_robot("b", "b", robot_with_laser((math.pi, 0, 0)), Pose((0, 0, 0.1)))
    assert scan(simulation, turned) == pytest.approx(expected[::-1], abs=1e-6)


@pytest.mark.parametrize("pitch", [0.05, 0.2, 1.0])
def test_a_laser_that_is_pitched_down_sees_the_floor(
    simulate: MakeSimulation, pitch: float
) -> None:
    simulation = simulate()
    entity = simulation.add_robot("r", "r", robot_with_laser((0, pitch, 0)), Pose((0, 0, 0.1)))
    seen = scan(simulation, entity)
    height = simulation.link_pose(entity, "eye").position[2]
    angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
    with np.errstate(divide="ignore"):
        expected = height / (math.sin(pitch) * np.cos(angles))
    hit = expected < REACH - 1e-3
    assert hit[90] == (height / math.sin(pitch) < REACH)
    assert seen[hit] == pytest.approx(expected[hit], rel=1e-5)
    assert np.isinf(seen[expected > REACH + 1e-3]).all()


def test_a_laser_that_is_pitched_up_sees_over_a_low_wall(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    simulation = simulate(
        box("low", Pose((2.0, 0.0, 0.25)), (0.2, 8.0, 0.5)),
        box("high", Pose((4.0, 0.0, 1.5)), (0.2, 8.0, 3.0)),
    )
    entity = simulation.add_robot("r", "r", robot_with_laser((0, -0.3, 0)), Pose((0, 0, 0.1)))
    assert scan(simulation, entity)[90] == pytest.approx(3.9 / math.cos(0.3), abs=1e-6)


def test_a_laser_on_a_joint_is_tilted_by_the_joint(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    simulation = simulate(box("wall", Pose((5.0, 0.0, 1.5)), (0.2, 8.0, 3.0)))
    model = robot_with_laser((0, 0, 0), "revolute")
    entity = simulation.add_robot("r", "r", model, Pose((0, 0, 0.1)))
    assert scan(simulation, entity)[90] == pytest.approx(4.9, abs=1e-3)
    simulation.set_joint(entity, "neck", 0.5)
    height = simulation.link_pose(entity, "eye").position[2]
    assert scan(simulation, entity)[90] == pytest.approx(height / math.sin(0.5), rel=1e-5)
    simulation.set_joint(entity, "neck", 0.0)
    assert scan(simulation, entity)[90] == pytest.approx(4.9, abs=1e-3)


@pytest.fixture
def client() -> Iterator[int]:
    made = pybullet.connect(pybullet.DIRECT)
    yield made
    pybullet.disconnect(made)


def reference_body(client: int, shape: Shape, pose: Pose) -> None:
    match shape:
        case Box(size=size):
            options = {"shapeType": pybullet.GEOM_BOX, "halfExtents": [s / 2 for s in size]}
        case Cylinder(radius=radius, length=length):
            options = {"shapeType": pybullet.GEOM_CYLINDER, "radius": radius, "height": length}
        case Sphere(radius=radius):
            options = {"shapeType": pybullet.GEOM_SPHERE, "radius": radius}
        case Mesh(path=path):
            options = {"shapeType": pybullet.GEOM_MESH, "fileName": path}
    made = pybullet.createCollisionShape(**options, physicsClientId=client)
    pybullet.createMultiBody(0, made, -1, pose.position, pose.rotation, physicsClientId=client)


def random_models(rng: np.random.Generator, mesh: Mesh) -> Iterator[Model]:
    """Yields static and moving models in a ring about the origin."""
    for number in range(40):
        shape: Shape = (
            Box(tuple(rng.uniform(0.2, 1.5, 3))),
            Cylinder(rng.uniform(0.1, 0.5), rng.uniform(0.3, 1.0)),
            Sphere(rng.uniform(0.2, 0.5)),
            mesh,
        )[number % 4]
        angle, distance = rng.uniform(-math.pi, math.pi), rng.uniform(1.5, 8.0)
        place = distance * math.cos(angle), distance * math.sin(angle), rng.uniform(0.0, 2.0)
        pose = Pose.from_rpy(*place, *rng.uniform(-3.0, 3.0, 3))
        links = (Link("link", mass=1.0, collisions=(Collision("c", Pose(), shape),)),)
        yield Model(f"m{number}", pose, number % 3 != 0, links)


@pytest.mark.parametrize("seed", range(6))
def test_tilted_scans_agree_with_the_engines_rays(
    simulate: MakeSimulation, client: int, tmp_path: Path, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    mesh = Mesh(str(write_drum(tmp_path / "drum.stl", 0.4, 0.6)))
    models = list(random_models(rng, mesh))
    simulation = simulate(*models)
    for one in models:
        reference_body(client, one.links[0].collisions[0].shape, one.pose)
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    pybullet.createMultiBody(0, plane, physicsClientId=client)
    errors = []
    for number in range(8):
        rpy = (*rng.uniform(-1.2, 1.2, 2), rng.uniform(-3.0, 3.0))
        name = f"r{number}"
        at = Pose.from_rpy(0.0, 0.0, 0.1, 0.0, 0.0, rng.uniform(-3.0, 3.0))
        entity = simulation.add_robot(name, name, robot_with_laser(rpy), at)
        sensor = simulation.link_pose(entity, "eye")
        ours = np.minimum(scan(simulation, entity), REACH)
        angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
        ends = [
            np.add(sensor.position, rotated(sensor.rotation, (REACH * math.cos(a), REACH * math.sin(a), 0.0)))
            for a in angles
        ]  # fmt: skip
        hits = pybullet.rayTestBatch([sensor.position] * 181, ends, physicsClientId=client)
        errors.append(np.abs(ours - np.array([hit[2] for hit in hits]) * REACH))
        simulation.remove(name)
    error = np.concatenate(errors)
    # A ray that grazes an edge may hit it in one and miss it in the other; cylinders are prisms here.
    assert np.mean(error < 0.02) > 0.97
    assert np.median(error) < 0.001
