"""Noise of every sensor has the deviation of its setting, and depends on seed, sensor and time alone."""

import random
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.sensors.camera import noisy
from pioneer_gazebo.sensors.inertial import InertialUnit, Truth
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Model, World
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Camera, GroundTruth, Imu
from pioneer_gazebo.world.urdf import robot_from_urdf

DEVIATION = 0.05

Reading = Callable[[], NDArray[np.float64]]

RAYS = """<ray><scan><horizontal><samples>9</samples><min_angle>-0.1</min_angle><max_angle>0.1</max_angle></horizontal>
</scan><range><min>0.05</min><max>30</max></range><noise><type>gaussian</type><mean>0</mean><stddev>0.05</stddev></noise>
</ray>"""

LINK = """<link name="{0}"><inertial><mass value="{1}"/>
<inertia ixx="{1}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>"""

LASER = f"""<sensor type="ray" name="scan">{RAYS}
<plugin name="p" filename="libgazebo_ros_laser.so"><topicName>scan</topicName></plugin></sensor>"""

ROBOT = f"""<robot name="r">{LINK.format("base", 5)}{LINK.format("head", 0.1)}
<joint name="neck" type="fixed"><parent link="base"/><child link="head"/><origin xyz="0 0 0.2"/></joint>
<gazebo><plugin name="sensor" filename="libhector_gazebo_ros_imu.so"><bodyName>base</bodyName>
<gaussianNoise>0.05</gaussianNoise></plugin>
<plugin name="sensor" filename="libgazebo_ros_p3d.so"><bodyName>base</bodyName><gaussianNoise>0.05</gaussianNoise>
</plugin></gazebo>
<gazebo reference="base">{LASER}
<sensor type="ray" name="range">{RAYS}<plugin name="p" filename="libgazebo_ros_range.so"><topicName>range</topicName>
<gaussianNoise>0.05</gaussianNoise></plugin></sensor></gazebo>
<gazebo reference="head">{LASER}
<sensor type="camera" name="eye"><camera><horizontal_fov>1</horizontal_fov>
<image><width>8</width><height>6</height></image>
<noise><type>gaussian</type><stddev>0.05</stddev></noise></camera>
<plugin name="p" filename="libgazebo_ros_camera.so"/></sensor></gazebo></robot>"""

GREY = np.full((6, 8, 3), 128, np.uint8)


@pytest.fixture
def make(box: Callable[..., Model]) -> Iterator[Callable[..., Simulation]]:
    """Returns a function that makes a world without gravity, with a wall 5 m ahead, by its seed."""
    engines: list[BulletEngine] = []

    def made(seed: int) -> Simulation:
        physics = Physics(gravity=(0.0, 0.0, 0.0))
        engines.append(BulletEngine(physics))
        simulation = Simulation(engines[-1], triangles_of_mesh, physics, seed)
        simulation.load(World("w", (box("wall", Pose((5.05, 0.0, 0.0)), (0.1, 40.0, 4.0)),)))
        return simulation

    yield made
    for engine in engines:
        engine.close()


def sensors_of(simulation: Simulation, entity: Entity) -> dict[str, Reading]:
    """Returns a function for each sensor that returns all its noisy values, without their means."""
    robot = entity.robot
    assert robot is not None
    [imu] = robot.of(Imu)
    [truth] = robot.of(GroundTruth)
    [camera] = robot.of(Camera)
    unit = InertialUnit(simulation, entity, imu)
    reporter = Truth(simulation, entity, truth)
    picture_noise = simulation.noise(entity, camera)

    def felt() -> NDArray[np.float64]:
        _, rates, accelerations = unit.measure()
        return np.array([*rates, *accelerations])

    def velocity() -> NDArray[np.float64]:
        _, motion = reporter.motion()
        return np.array([*motion.linear, *motion.angular])

    def picture() -> NDArray[np.float64]:
        noise = picture_noise.at(simulation.tick)
        return (noisy(GREY, camera.noise_stddev, noise) - 127.5).ravel() / 255.0

    def scan(number: int) -> Reading:
        angles = np.linspace(-0.1, 0.1, 9)
        return lambda: simulation.ranges(entity, entity.lasers[number]) - 5.0 / np.cos(angles)

    return {
        "imu": felt,
        "truth": velocity,
        "camera": picture,
        "scan": scan(0),
        "upper scan": scan(1),
        "sonar": lambda: np.array([simulation.distance(entity, entity.sonars[0]) - 5.0]),
    }


def recorded(
    simulation: Simulation, ticks: list[int], wanted: Callable[[str, int], bool]
) -> dict[tuple[str, int], bytes]:
    entity = simulation.add_robot("r", "r", robot_from_urdf(ROBOT), Pose())
    sensors = sensors_of(simulation, entity)
    found = {}
    for tick in ticks:
        simulation.advance(tick)
        for name, read in sensors.items():
            if wanted(name, tick):
                found[name, tick] = read().tobytes()
    return found


def test_mean_and_spread_of_every_sensors_noise_are_those_of_its_setting(
    make: Callable[..., Simulation],
) -> None:
    simulation = make(1)
    entity = simulation.add_robot("r", "r", robot_from_urdf(ROBOT), Pose())
    sensors = sensors_of(simulation, entity)
    values: dict[str, list[NDArray[np.float64]]] = {name: [] for name in sensors}
    for tick in range(1, 3001):
        simulation.advance(tick)
        for name, read in sensors.items():
            values[name].append(read().copy())
    for name, rows in values.items():
        table = np.array(rows)
        count = table.size
        # Values of pictures are rounded down to whole steps of 1/255.
        assert np.mean(table) == pytest.approx(0.0, abs=4.5 * DEVIATION / np.sqrt(count)), name
        assert np.std(table) == pytest.approx(DEVIATION, rel=5.0 / np.sqrt(2 * count)), name
        following = np.mean(table[1:] * table[:-1]) / DEVIATION**2
        assert abs(following) < 5.0 / np.sqrt(count), f"{name}: readings that follow are alike"
    lower = np.array(values["scan"]).ravel()
    upper = np.array(values["upper scan"]).ravel()
    assert abs(np.corrcoef(lower, upper)[0, 1]) < 5.0 / np.sqrt(len(lower)), "lasers of one name"


@pytest.mark.parametrize("seed", range(3))
def test_readings_are_the_same_whoever_else_reads(
    make: Callable[..., Simulation], seed: int
) -> None:
    drawn = random.Random(seed)
    ticks = sorted(drawn.sample(range(1, 900), 40))
    everything = recorded(make(7), ticks, lambda name, tick: True)
    some = recorded(make(7), ticks, lambda name, tick: drawn.random() < 0.3)
    assert some
    assert some.items() <= everything.items()
    other = recorded(make(8), ticks, lambda name, tick: True)
    for key, value in everything.items():
        assert other[key] != value, f"{key} does not depend on the seed"


def test_after_a_reset_every_sensor_reads_the_same_noise_again(
    make: Callable[..., Simulation],
) -> None:
    simulation = make(2)
    entity = simulation.add_robot("r", "r", robot_from_urdf(ROBOT), Pose())
    sensors = sensors_of(simulation, entity)
    runs = []
    for _ in range(2):
        run = []
        for tick in range(5, 300, 7):
            simulation.advance(tick)
            run.append({name: read().tobytes() for name, read in sensors.items()})
        runs.append(run)
        simulation.reset()
    assert runs[0] == runs[1]
