"""Shared fixtures of the simulator's tests: a robot, and worlds on the real engine."""

import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.simulation.noise_profile import DESCRIBED, NoiseProfile
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Box, Collision, Link, Model, Plane, World
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot
from pioneer_gazebo.world.urdf import robot_from_urdf

MakeSimulation = Callable[..., Simulation]


def floor() -> Model:
    return Model(
        "floor", static=True, links=(Link("link", collisions=(Collision("c", Pose(), Plane()),)),)
    )


def box_model(
    name: str, pose: Pose, size: tuple[float, float, float], static: bool = True, mass: float = 1.0
) -> Model:
    collision = Collision("collision", Pose(), Box(size))
    return Model(name, pose, static, (Link("link", mass=mass, collisions=(collision,)),))


@pytest.fixture(autouse=True)
def _source_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Finds packages in the source tree, with or without a sourced workspace."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(Path(__file__).parents[4]))


@pytest.fixture(name="box")
def box_fixture() -> Callable[..., Model]:
    return box_model


@pytest.fixture(scope="session")
def robot() -> Robot:
    return robot_from_urdf((Path(__file__).parent / "pioneer.urdf").read_text())


SIDES = 24


def write_drum(path: Path, radius: float, width: float) -> Path:
    """Writes a cylinder around the y axis as binary STL."""
    rim = [
        (radius * math.cos(a), radius * math.sin(a)) for a in np.arange(SIDES) * math.tau / SIDES
    ]
    triangles = []
    for (x, z), (u, w) in zip(rim, rim[1:] + rim[:1], strict=True):
        near, far = -width / 2, width / 2
        triangles += [
            [(x, near, z), (u, near, w), (u, far, w)],
            [(x, near, z), (u, far, w), (x, far, z)],
        ]
        triangles += [
            [(0, near, 0), (u, near, w), (x, near, z)],
            [(0, far, 0), (x, far, z), (u, far, w)],
        ]
    data = bytes(80) + struct.pack("<I", len(triangles))
    for triangle in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *np.ravel(triangle), 0)
    path.write_bytes(data)
    return path


def _link(name: str, mass: float, shape: str, size: float) -> str:
    moment = 0.4 * mass * size**2
    return f"""<link name="{name}"><inertial><mass value="{mass}"/>
      <inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry>{shape}</geometry></collision></link>"""


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str = "0 1 0") -> str:
    return f"""<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>
      <axis xyz="{axis}"/></joint>"""


@pytest.fixture
def mesh_robot(tmp_path: Path) -> Robot:
    """Returns a robot whose wheels, hubcaps and caster are meshes, as in the original description."""
    folder = tmp_path
    tyre = f'<mesh filename="{write_drum(folder / "tyre.stl", 0.0975, 0.04)}"/>'
    cap = f'<mesh filename="{write_drum(folder / "cap.stl", 0.05, 0.044)}"/>'
    small = f'<mesh filename="{write_drum(folder / "small.stl", 0.0375, 0.025)}"/>'
    parts = [
        _link("base_link", 7.0, '<box size="0.44 0.30 0.16"/>', 0.2),
        _link("swivel", 0.15, '<box size="0.02 0.02 0.02"/>', 0.05),
        _link("center_wheel", 0.2, small, 0.04),
        _link("center_hubcap", 0.05, small, 0.04),
        _joint("base_swivel_joint", "continuous", "base_link", "swivel", "-0.2 0 -0.045", "0 0 1"),
        _joint("swivel_wheel_joint", "continuous", "swivel", "center_wheel", "-0.024 0 -0.0525"),
        _joint("center_cap_joint", "fixed", "center_wheel", "center_hubcap", "0 0 0"),
    ]
    for side, y in (("left", 0.165), ("right", -0.165)):
        parts += [
            _link(f"{side}_wheel", 0.6, tyre, 0.1),
            _link(f"{side}_hub", 0.1, cap, 0.05),
            _joint(f"{side}_joint", "continuous", "base_link", f"{side}_wheel", f"0 {y} -0.0375"),
            _joint(f"{side}_hub_joint", "fixed", f"{side}_wheel", f"{side}_hub", "0 0 0"),
        ]
    drive = """<gazebo><plugin name="drive" filename="libgazebo_ros_diff_drive.so">
      <leftJoint>left_joint</leftJoint><rightJoint>right_joint</rightJoint><odometrySource>encoder</odometrySource>
      <wheelSeparation>0.33</wheelSeparation><wheelDiameter>0.195</wheelDiameter><wheelAcceleration>3</wheelAcceleration>
      </plugin></gazebo><gazebo reference="center_wheel"><mu1 value="0.1"/></gazebo>"""
    return robot_from_urdf(f'<robot name="original">{"".join(parts)}{drive}</robot>')


@pytest.fixture
def simulate() -> Iterator[MakeSimulation]:
    """Returns a function that makes a world with a floor and the given models; closes the engines afterwards."""
    engines: list[BulletEngine] = []

    def make(
        *models: Model,
        seed: int = 0,
        odometry_error: float = 0.0,
        odometry_scale: float = 1.0,
        noise: NoiseProfile = DESCRIBED,
    ) -> Simulation:
        engine = BulletEngine()
        engines.append(engine)
        simulation = Simulation(
            engine, triangles_of_mesh, Physics(), seed, odometry_error, odometry_scale, noise
        )
        simulation.load(World("test", (floor(), *models)))
        return simulation

    yield make
    for engine in engines:
        engine.close()
