"""What several tests of the simulator need: a robot, and worlds on the real engine."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pioneer_gazebo.adapters.bullet import BulletEngine
from pioneer_gazebo.adapters.mesh import triangles_of_mesh
from pioneer_gazebo.adapters.urdf import robot_from_urdf
from pioneer_gazebo.core.engine import Physics
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.robot import Robot
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.core.world import Box, Collision, Link, Model, Plane, World

MakeSimulation = Callable[..., Simulation]


def floor() -> Model:
    return Model("floor", static=True, links=(Link("link", collisions=(Collision("c", Pose(), Plane()),)),))


def box_model(name: str, pose: Pose, size: tuple[float, float, float], static: bool = True, mass: float = 1.0) -> Model:
    collision = Collision("collision", Pose(), Box(size))
    return Model(name, pose, static, (Link("link", mass=mass, collisions=(collision,)),))


@pytest.fixture(autouse=True)
def _source_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Packages are found in the source tree, with or without a sourced workspace."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(Path(__file__).parents[4]))


@pytest.fixture(name="box")
def box_fixture() -> Callable[..., Model]:
    return box_model


@pytest.fixture(scope="session")
def robot() -> Robot:
    return robot_from_urdf((Path(__file__).parent / "pioneer.urdf").read_text())


@pytest.fixture
def simulate() -> Iterator[MakeSimulation]:
    """Makes worlds of a floor and the models given, on engines that are closed afterwards."""
    engines: list[BulletEngine] = []

    def make(*models: Model, seed: int = 0, odometry_error: float = 0.0, odometry_scale: float = 1.0) -> Simulation:
        engine = BulletEngine(triangles_of_mesh)
        engines.append(engine)
        simulation = Simulation(engine, triangles_of_mesh, Physics(), seed, odometry_error, odometry_scale)
        simulation.load(World("test", (floor(), *models)))
        return simulation

    yield make
    for engine in engines:
        engine.close()
