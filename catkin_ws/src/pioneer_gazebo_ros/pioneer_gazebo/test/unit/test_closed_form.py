"""Sensors read a motion whose formula is known, at any rate, also between physics steps."""

import math
from collections.abc import Callable, Iterator

import pytest

from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics, Velocity
from pioneer_gazebo.sensors.inertial import InertialUnit, Receiver, Truth
from pioneer_gazebo.simulation.actor import Wrench
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.simulation.state import link_motion, wrench
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Model, World
from pioneer_gazebo.world.pose import Pose, rotated
from pioneer_gazebo.world.robot import Gps, GroundTruth, Imu, Robot
from pioneer_gazebo.world.urdf import robot_from_urdf

MASS = 4.0
ARM = 0.25
"""Distance of the mast from the base's axis [m]."""

SENSORS = """
<gazebo><plugin name="imu" filename="libhector_gazebo_ros_imu.so"><bodyName>{0}</bodyName></plugin>
<plugin name="gps" filename="libhector_gazebo_ros_gps.so"><bodyName>{0}</bodyName></plugin>
<plugin name="truth" filename="libgazebo_ros_p3d.so"><bodyName>{0}</bodyName></plugin></gazebo>
<gazebo reference="{0}"><sensor type="ray" name="scan"><ray><scan><horizontal><samples>3</samples>
  <min_angle>-0.1</min_angle><max_angle>0.1</max_angle></horizontal></scan><range><min>0.05</min><max>30</max></range></ray>
  <plugin name="p" filename="libgazebo_ros_laser.so"><topicName>scan</topicName></plugin></sensor>
<sensor type="ray" name="range"><ray><scan><horizontal><samples>3</samples><min_angle>-0.1</min_angle>
  <max_angle>0.1</max_angle></horizontal></scan><range><min>0.05</min><max>30</max></range></ray>
  <plugin name="p" filename="libgazebo_ros_range.so"><topicName>range</topicName><fov>0.2</fov></plugin></sensor>
</gazebo>
"""

INERTIA = (
    '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


def link(name: str, mass: float, shape: str = "") -> str:
    collision = f"<collision><geometry>{shape}</geometry></collision>" if shape else ""
    return f'<link name="{name}">{INERTIA.format(mass, 0.1 * mass)}{collision}</link>'


def slider(link_name: str = "base") -> Robot:
    """Returns a box that moves in the plane, with a mast beside its axis; one of the two has all sensors."""
    return robot_from_urdf(
        f"""<robot name="slider">{link("base", MASS, '<box size="0.3 0.3 0.2"/>')}{link("mast", 0.001)}
        <joint name="stand" type="fixed"><parent link="base"/><child link="mast"/><origin xyz="{ARM} 0 0"/></joint>
        <gazebo><plugin name="move" filename="libgazebo_ros_planar_move.so"/></gazebo>
        {SENSORS.format(link_name)}</robot>"""
    )


def turner() -> Robot:
    """Returns a base with an arm that turns about a vertical joint and carries all sensors at its end."""
    return robot_from_urdf(
        f"""<robot name="turner">{link("base", 1000.0, '<box size="0.3 0.3 0.2"/>')}{link("arm", 0.01)}
        {link("tip", 0.01)}
        <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.2"/>
        <axis xyz="0 0 1"/></joint>
        <joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="{ARM} 0 0"/></joint>
        {SENSORS.format("tip")}</robot>"""
    )


@pytest.fixture
def space(box: Callable[..., Model]) -> Iterator[Simulation]:
    """Returns a world without gravity and ground, with a wall at x = 10 m."""
    engine = BulletEngine(Physics(gravity=(0.0, 0.0, 0.0)))
    simulation = Simulation(engine, triangles_of_mesh, Physics(gravity=(0.0, 0.0, 0.0)))
    simulation.load(World("w", (box("wall", Pose((10.05, 0.0, 0.0)), (0.1, 40.0, 4.0)),)))
    yield simulation
    engine.close()


class Instruments:
    """All sensors of a robot."""

    def __init__(self, simulation: Simulation, entity: Entity) -> None:
        assert entity.robot is not None
        robot = entity.robot
        self.imu = InertialUnit(simulation, entity, robot.of(Imu)[0])
        self.gps = Receiver(simulation, entity, robot.of(Gps)[0])
        self.truth = Truth(simulation, entity, robot.of(GroundTruth)[0])


def ticks(rate: int, seconds: float) -> Iterator[int]:
    """Yields the ticks nearest to the times of a rate [Hz]."""
    for number in range(1, int(rate * seconds) + 1):
        yield round(number * TICK_RATE / rate)


RATES = (7, 50, 100, 333)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("link_name", ["base", "mast"])
def test_sensors_read_a_constant_acceleration(space: Simulation, rate: int, link_name: str) -> None:
    acceleration = 3.0
    entity = space.add_robot("r", "r", slider(link_name), Pose())
    entity.movers.clear()
    force = ((MASS + 0.001) * acceleration, 0.0, 0.0)
    space.push(Wrench(entity, 0, force, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0, math.inf))
    instruments = Instruments(space, entity)
    offset = ARM if link_name == "mast" else 0.0
    step = space.physics.step
    for tick in ticks(rate, 1.0):
        space.advance(tick)
        time = tick / TICK_RATE
        speed = acceleration * time
        # The engine's steps, which use the speed at their ends, lead by half a step; between them the path is straight.
        whole = math.floor(time / step + 1e-9) * step
        x = acceleration * (whole * (whole + step) / 2 + (time - whole) * (whole + step)) + offset
        _, rates, felt = instruments.imu.measure()
        assert felt == pytest.approx((acceleration, 0.0, 0.0), abs=1e-6)
        assert rates == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        pose, velocity = instruments.truth.motion()
        assert pose.position == pytest.approx((x, 0.0, 0.0), abs=1e-6)
        assert velocity.linear == pytest.approx((speed, 0.0, 0.0), abs=1e-6)
        _, to_north = instruments.gps.measure()
        assert to_north == pytest.approx((speed, 0.0, 0.0), abs=1e-6)
        assert space.ranges(entity, entity.lasers[0])[1] == pytest.approx(10.0 - x, abs=1e-5)
        assert space.distance(entity, entity.sonars[0]) == pytest.approx(10.0 - x, abs=1e-5)


@pytest.mark.parametrize("rate", RATES)
def test_sensors_read_a_circle(space: Simulation, rate: int) -> None:
    speed, turn = 0.5, 0.8
    radius = speed / turn
    entity = space.add_robot("r", "r", slider(), Pose())
    entity.movers[0].command(space.moment, speed, 0.0, turn)
    instruments = Instruments(space, entity)
    for tick in ticks(rate, 2.0):
        if tick <= 12:
            continue  # the command takes effect at once, which is no circle
        space.advance(tick)
        yaw = turn * tick / TICK_RATE
        rotation, rates, felt = instruments.imu.measure()
        assert 2.0 * math.atan2(rotation[2], rotation[3]) == pytest.approx(yaw, abs=1e-5)
        assert rates == pytest.approx((0.0, 0.0, turn), abs=1e-5)
        # A step goes straight in the direction at its beginning, and the acceleration is that of its middle.
        lag = 1.5 * turn * space.physics.step
        assert felt == pytest.approx((0.0, speed * turn, 0.0), abs=speed * turn * lag)
        pose, velocity = instruments.truth.motion()
        expected = (radius * math.sin(yaw), radius * (1.0 - math.cos(yaw)), 0.0)
        assert pose.position == pytest.approx(expected, abs=radius * lag)
        assert math.hypot(*velocity.linear) == pytest.approx(speed, rel=lag**2)
        _, to_north = instruments.gps.measure()
        assert to_north == pytest.approx(velocity.linear, abs=1e-9)
        distance = (10.0 - pose.position[0]) / math.cos(yaw)
        if 0.0 < distance < 15.0:
            seen = space.ranges(entity, entity.lasers[0])[1]
            assert seen == pytest.approx(distance, abs=1e-4)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("make", [lambda: slider("mast"), turner])
def test_sensors_on_a_link_off_the_axis_read_a_spin(
    space: Simulation, rate: int, make: Callable[[], Robot]
) -> None:
    turn = 2.0
    entity = space.add_robot("r", "r", make(), Pose())
    if entity.movers:
        entity.movers[0].command(space.moment, 0.0, 0.0, turn)
    else:
        space._engine.turn(entity.handle, [1], [turn], [1e3])
    instruments = Instruments(space, entity)
    space.advance(12)
    begin = turn * 12 / TICK_RATE
    for tick in ticks(rate, 1.5):
        if tick <= 12:
            continue
        space.advance(tick)
        yaw = begin + turn * (tick - 12) / TICK_RATE
        _, rates, felt = instruments.imu.measure()
        lag = turn * space.physics.step
        assert rates == pytest.approx((0.0, 0.0, turn), abs=2e-4)
        assert felt[0] == pytest.approx(-ARM * turn**2, rel=lag**2)
        assert felt[1] == pytest.approx(0.0, abs=ARM * turn**2 * lag)
        pose, velocity = instruments.truth.motion()
        x, y, _ = pose.position
        assert (x, y) == pytest.approx((ARM * math.cos(yaw), ARM * math.sin(yaw)), abs=3e-4)
        assert math.hypot(*velocity.linear) == pytest.approx(ARM * turn, rel=lag**2)


def wagon() -> Robot:
    wheels = "".join(
        link(f"{side}_wheel", 0.5, '<cylinder radius="0.1" length="0.04"/>')
        + f"""<joint name="{side}" type="continuous"><parent link="base"/><child link="{side}_wheel"/>
        <origin xyz="0 {y} 0" rpy="-1.5707963 0 0"/><axis xyz="0 0 1"/></joint>"""
        for side, y in (("left", 0.2), ("right", -0.2))
    )
    return robot_from_urdf(
        f"""<robot name="wagon">{link("base", MASS, '<box size="0.3 0.3 0.1"/>')}{wheels}
        <gazebo><plugin name="d" filename="libgazebo_ros_diff_drive.so"><leftJoint>left</leftJoint>
        <rightJoint>right</rightJoint><wheelSeparation>0.4</wheelSeparation><wheelDiameter>0.2</wheelDiameter>
        <wheelAcceleration>1</wheelAcceleration><publishWheelTF>true</publishWheelTF><wheelTorque>1000</wheelTorque>
        </plugin></gazebo></robot>"""
    )


@pytest.mark.parametrize("rate", RATES)
def test_wheels_joints_and_odometry_read_a_constant_acceleration(
    space: Simulation, rate: int
) -> None:
    """Without ground the wheels turn as commanded: 10 rad/s² up to 5 rad/s."""
    entity = space.add_robot("r", "r", wagon(), Pose())
    [driven] = entity.drives
    driven.command(space.moment, 0.5, 0.0)
    step = space.physics.step
    for tick in ticks(rate, 0.45):
        space.advance(tick)
        time = tick / TICK_RATE
        whole = math.floor(time / step + 1e-9) * step
        angle = 10.0 * (whole * (whole + step) / 2 + (time - whole) * (whole + step))
        for position, speed in space.joints(entity, driven.parts):
            assert position == pytest.approx(angle, abs=2e-3)
            assert speed == pytest.approx(10.0 * time, abs=2e-2)
        odometry = space.odometry(driven)
        assert odometry.x == pytest.approx(0.1 * angle, abs=2e-4)
        assert odometry.speed == pytest.approx(1.0 * time, abs=2e-3)
        base = space.link_pose(entity, "base")
        for side in ("left", "right"):
            wheel = base.inverse().compose(space.link_pose(entity, f"{side}_wheel"))
            ahead = rotated(wheel.rotation, (1.0, 0.0, 0.0))
            assert math.atan2(-ahead[2], ahead[0]) == pytest.approx(angle, abs=2e-3)


def test_a_links_motion_is_the_same_by_the_engine_and_between_steps(space: Simulation) -> None:
    """Right before the end of a step the interpolated motion is nearly the engine's."""
    entity = space.add_robot("r", "r", turner(), Pose())
    space._engine.set_velocity(entity.handle, Velocity((0.3, 0.1, 0.0), (0.1, 0.2, 0.3)))
    space._engine.turn(entity.handle, [1], [1.5], [1e3])
    space.advance(120)
    space.advance(121)
    space._part = 1.0 - 1e-12
    pose, velocity = link_motion(space, "r", "tip")
    space._part = 1.0
    exact_pose, exact_velocity = link_motion(space, "r", "tip")
    assert pose.position == pytest.approx(exact_pose.position, abs=1e-6)
    assert velocity.linear == pytest.approx(exact_velocity.linear, abs=1e-5)
    assert velocity.angular == pytest.approx(exact_velocity.angular, abs=1e-5)


def test_another_physics_step_moves_no_robot(space: Simulation) -> None:
    entity = space.add_robot("r", "r", slider(), Pose())
    entity.movers[0].command(space.moment, 2.0, 0.0, 0.0)
    space.advance(605)
    before = space.pose(entity).position[0]
    for step in (0.04, 0.01, 1 / 600, 0.1):
        space.configure(Physics(step, gravity=(0.0, 0.0, 0.0)))
        space.advance(space.tick)
        assert space.pose(entity).position[0] == pytest.approx(before, abs=1e-9)
    for tick in range(606, 900):
        space.advance(tick)
        x = space.pose(entity).position[0]
        assert x - before == pytest.approx(2.0 / TICK_RATE, abs=1e-6)
        before = x


def test_setting_a_wheels_joint_moves_no_odometry(space: Simulation) -> None:
    entity = space.add_robot("r", "r", wagon(), Pose())
    [driven] = entity.drives
    space.advance(60)
    for tick, position in ((66, 25.0), (70, -3.0), (96, 1.0)):
        space.set_joint(entity, "left", position)
        space.advance(tick)
        odometry = space.odometry(driven)
        assert (odometry.x, odometry.yaw) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_wrench_in_the_world_turns_a_body_only_by_its_torque_and_point(space: Simulation) -> None:
    """As in gazebo_ros: the force acts at the centre of mass, wherever the body is and moves to."""
    entity = space.add_robot("r", "r", slider(), Pose((3.0, -2.0, 0.0)))
    entity.movers.clear()
    zero = (0.0, 0.0, 0.0)
    force = (2.0 * MASS, 0.0, 0.0)
    applied, torque = wrench(space, "r::base", "world", zero, force, zero)
    assert (applied, torque) == (force, zero)
    space.push(Wrench(entity, 0, applied, torque, None, 0, math.inf))
    space.advance(1200)
    assert space.velocity(entity).linear[0] == pytest.approx(4.0, rel=1e-3)
    assert space.velocity(entity).angular == pytest.approx(zero, abs=1e-3)
    _, torque = wrench(space, "r::base", "", (0.0, 0.5, 0.0), force, (0.0, 0.0, 1.0))
    assert torque == pytest.approx((0.0, 0.0, 1.0 - 0.5 * force[0]))
    # In the frame of the mast, which stands ahead: its place is part of the arm.
    sideways = (0.0, 3.0, 0.0)
    _, torque = wrench(space, "r::base", "r::mast", zero, sideways, zero)
    assert torque == pytest.approx((0.0, 0.0, 3.0 * ARM), abs=1e-6)
