"""Drives, controllers and sensors of common robots other than the Pioneer."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from gazebo_msgs.msg import ContactsState

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.sensors.camera import points_of
from pioneer_gazebo.sensors.inertial import InertialUnit, Receiver, Truth
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.simulation.state import place, relative
from pioneer_gazebo.topics.sensor_messages import info_of
from pioneer_gazebo.topics.sensor_topics import bumper_topics
from pioneer_gazebo.world.model import Model
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import (
    Bumper,
    Camera,
    Gps,
    GroundTruth,
    Imu,
    JointStatePublisher,
    LaserSensor,
    PlanarMove,
    Robot,
)
from pioneer_gazebo.world.ros_control import controlled
from pioneer_gazebo.world.sdf import world_from_sdf_text
from pioneer_gazebo.world.urdf import robot_from_urdf

MakeSimulation = Callable[..., Simulation]

SIDES = (("left", 0.2), ("right", -0.2))
WHEELS = [
    (f"{end}_{side}", x, y) for end, x in (("front", 0.15), ("rear", -0.15)) for side, y in SIDES
]
LIGHT = "<inertial><mass>2</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial>"
SKID = """<gazebo><plugin name="skid" filename="libgazebo_ros_skid_steer_drive.so">
<leftFrontJoint>front_left</leftFrontJoint><rightFrontJoint>front_right</rightFrontJoint>
<leftRearJoint>rear_left</leftRearJoint><rightRearJoint>rear_right</rightRearJoint>
<wheelSeparation>0.4</wheelSeparation><wheelDiameter>0.2</wheelDiameter><torque>20</torque>
<robotNamespace>/husky</robotNamespace><broadcastTF>false</broadcastTF></plugin></gazebo>"""


def rover(
    extra: str = "", wheels: str = '<cylinder radius="0.1" length="0.08"/>', smooth: bool = False
) -> Robot:
    """Returns a four-wheeled robot; its rear wheels slide if ``smooth``."""
    links = ['<link name="base"><inertial><mass value="15"/><inertia ixx="0.3" iyy="0.4" izz="0.6"/></inertial>'
             '<collision><geometry><box size="0.5 0.28 0.15"/></geometry></collision></link>']  # fmt: skip
    for name, x, y in WHEELS:
        links.append(
            f'<link name="{name}_wheel"><inertial><mass value="0.5"/><inertia ixx="0.002" iyy="0.003" izz="0.002"/>'
            f'</inertial><collision><origin rpy="{math.pi / 2} 0 0"/><geometry>{wheels}</geometry></collision></link>'
            f'<joint name="{name}" type="continuous"><origin xyz="{x} {y} 0"/><parent link="base"/>'
            f'<child link="{name}_wheel"/><axis xyz="0 1 0"/></joint>'
        )
        if smooth and name.startswith("rear"):
            links.append(f'<gazebo reference="{name}_wheel"><mu1>0</mu1></gazebo>')
    return robot_from_urdf(f'<robot name="rover">{"".join(links)}{extra}</robot>')


KOBUKI = """<robot name="kobuki"><link name="base_footprint"/><link name="base_link"><inertial><mass value="2.4"/>
<inertia ixx="0.02" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.06"/><geometry><cylinder radius="0.17" length="0.1"/></geometry></collision></link>
<joint name="base_joint" type="fixed"><origin xyz="0 0 0.01"/><parent link="base_footprint"/>
<child link="base_link"/></joint>
{wheels}
<link name="caster"><collision><geometry><sphere radius="0.017"/></geometry></collision></link>
<link name="caster_back"><collision><geometry><sphere radius="0.017"/></geometry></collision></link>
<joint name="front" type="fixed"><origin xyz="0.115 0 0.007"/><parent link="base_link"/><child link="caster"/></joint>
<joint name="back" type="fixed"><origin xyz="-0.135 0 0.009"/><parent link="base_link"/>
<child link="caster_back"/></joint>
<gazebo reference="caster"><mu1>0</mu1></gazebo><gazebo reference="caster_back"><mu1>0</mu1></gazebo>
<gazebo><plugin name="kobuki_controller" filename="libgazebo_ros_kobuki.so"><publish_tf>1</publish_tf>
<left_wheel_joint_name>wheel_left_joint</left_wheel_joint_name>
<right_wheel_joint_name>wheel_right_joint</right_wheel_joint_name>
<wheel_separation>.230</wheel_separation><wheel_diameter>0.070</wheel_diameter><torque>1.0</torque>
<velocity_command_timeout>0.6</velocity_command_timeout><cliff_detection_threshold>0.04</cliff_detection_threshold>
<bumper_name>bumpers</bumper_name><imu_name>imu</imu_name></plugin></gazebo></robot>"""


def kobuki() -> Robot:
    """Returns a robot like a Kobuki, the base of a TurtleBot 2."""
    wheel = """<link name="wheel_{side}"><inertial><mass value="0.1"/><inertia ixx="0.0002" iyy="0.0002" izz="0.0002"/>
</inertial><collision><geometry><cylinder radius="0.035" length="0.02"/></geometry></collision></link>
<joint name="wheel_{side}_joint" type="continuous"><origin xyz="0 {y} 0.025" rpy="-1.5707963 0 0"/>
<parent link="base_link"/><child link="wheel_{side}"/><axis xyz="0 0 1"/></joint>"""
    wheels = wheel.format(side="left", y=0.115) + wheel.format(side="right", y=-0.115)
    return robot_from_urdf(KOBUKI.format(wheels=wheels))


def test_a_kobuki_has_its_own_topics_and_drives_as_commanded(simulate: MakeSimulation) -> None:
    robot = kobuki()
    [drive], [imu] = robot.drives, robot.of(Imu)
    assert (drive.commandTopic, drive.odometryTopic) == ("mobile_base/commands/velocity", "odom")
    assert (drive.robotBaseFrame, drive.publishTf, drive.commandTimeout) == (
        "base_footprint",
        True,
        0.6,
    )
    assert imu.topicName == "mobile_base/sensors/imu_data"
    named = " ".join(robot.warnings)
    assert "cliff_detection_threshold" in named
    assert "bumper_name" in named
    simulation = simulate()
    entity = simulation.add_robot("r", "r", robot, Pose())
    for _ in range(20):
        entity.drives[0].drive.command(0.3, 0.0)
        run(simulation, 0.1)
    odometry = simulation.odometry(entity.drives[0])
    assert odometry.x == pytest.approx(0.6, abs=0.05)
    assert simulation.pose(entity).position[0] == pytest.approx(odometry.x, abs=0.03)
    run(simulation, 2.0)
    stopped = simulation.pose(entity).position[0]
    run(simulation, 1.0)
    assert simulation.pose(entity).position[0] == pytest.approx(stopped, abs=1e-3)


def test_a_force_based_base_moves_as_commanded_and_its_gains_are_named() -> None:
    plugin = """<gazebo><plugin name="m" filename="libgazebo_ros_force_based_move.so"><commandTopic>go</commandTopic>
<odometryRate>50.0</odometryRate><publishOdometryTf>{tf}</publishOdometryTf>
<force_x_velocity_p_gain>1e4</force_x_velocity_p_gain></plugin></gazebo>"""
    robot = rover(plugin.format(tf="true"))
    [mover] = robot.of(PlanarMove)
    assert (mover.commandTopic, mover.odometryRate) == ("go", 50.0)
    assert len(robot.warnings) == 1
    assert "force_x_velocity_p_gain" in robot.warnings[0]
    assert mover.publishTf
    [silent] = rover(plugin.format(tf="false")).of(PlanarMove)
    assert not silent.publishTf


def run(simulation: Simulation, seconds: float) -> None:
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


def spawned(simulation: Simulation, robot: Robot) -> Entity:
    entity = simulation.add_robot("r", "r", robot, Pose((0.0, 0.0, 0.1)))
    run(simulation, 1.0)
    return entity


def test_a_skid_steer_robot_drives_straight_and_turns_to_the_left(simulate: MakeSimulation) -> None:
    simulation = simulate()
    robot = rover(SKID)
    assert (robot.namespace, robot.warnings, robot.drives[0].publishOdomTF) == ("husky", (), False)
    entity = spawned(simulation, robot)
    entity.drives[0].drive.command(0.5, 0.0)
    run(simulation, 4.0)
    x, y, _ = simulation.pose(entity).position
    assert x == pytest.approx(2.0, abs=0.1)
    assert abs(y) < 0.03
    assert abs(simulation.pose(entity).yaw) < 0.03
    entity.drives[0].drive.command(0.0, 1.0)
    run(simulation, 2.0)
    assert simulation.pose(entity).yaw > 0.4


@pytest.mark.parametrize("extra", [SKID, ""])
@pytest.mark.parametrize(
    "wheels", ['<cylinder radius="0.1" length="0.08"/>', '<sphere radius="0.1"/>']
)
def test_four_wheels_without_a_command_stay_where_they_are(
    simulate: MakeSimulation, extra: str, wheels: str
) -> None:
    simulation = simulate()
    entity = spawned(simulation, rover(extra, wheels))
    before = simulation.pose(entity)
    run(simulation, 20.0)
    after = simulation.pose(entity)
    assert math.dist(before.position, after.position) < 0.005
    assert abs(after.yaw - before.yaw) < 0.005


def test_a_planar_move_goes_sideways_and_stops(simulate: MakeSimulation) -> None:
    simulation = simulate()
    plugin = '<gazebo><plugin name="p" filename="libgazebo_ros_planar_move.so"/></gazebo>'
    entity = spawned(simulation, rover(plugin))
    [mover] = entity.movers
    mover.command(simulation.moment, 0.0, 0.3, 0.0)
    run(simulation, 2.0)
    x, y, z = simulation.pose(entity).position
    assert (x, y) == pytest.approx((0.0, 0.6), abs=0.02)
    assert z == pytest.approx(0.1, abs=0.005)
    mover.command(simulation.moment, 0.0, 0.0, 0.0)
    run(simulation, 5.0)
    assert math.dist(simulation.pose(entity).position, (x, y, z)) < 0.01


def test_an_imu_feels_gravity_rates_and_acceleration(simulate: MakeSimulation) -> None:
    simulation = simulate()
    plugin = """<gazebo><plugin name="imu" filename="libhector_gazebo_ros_imu.so"><bodyName>base</bodyName>
    <frameId>imu_frame</frameId><updateRate>50</updateRate></plugin>
    <plugin name="p" filename="libgazebo_ros_planar_move.so"/></gazebo>"""
    robot = rover(plugin)
    [config] = robot.of(Imu)
    assert (config.frame, config.updateRate, robot.warnings) == ("imu_frame", 50.0, ())
    entity = spawned(simulation, robot)
    unit = InertialUnit(simulation, entity, config)
    run(simulation, 1.0)
    _, rates, felt = unit.measure()
    assert rates == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert felt == pytest.approx((0.0, 0.0, 9.81), abs=0.05)
    entity.movers[0].command(simulation.moment, 0.5, 0.0, 0.8)
    run(simulation, 0.5)
    _, rates, felt = unit.measure()
    assert rates[2] == pytest.approx(0.8, abs=0.05)
    # On a circle it points to the centre, which lies to the left: speed times turn rate.
    assert felt == pytest.approx((0.0, 0.4, 9.81), abs=0.05)


def test_a_sensor_of_type_imu_is_an_imu_of_its_link() -> None:
    robot = rover("""<gazebo reference="base"><sensor name="imu" type="imu"><plugin name="p"
    filename="libgazebo_ros_imu_sensor.so"><topicName>imu/data</topicName><updateRateHZ>100</updateRateHZ>
    <gaussianNoise>0.1</gaussianNoise><frameName>base</frameName></plugin></sensor></gazebo>""")
    [config] = robot.of(Imu)
    assert (config.bodyName, config.topicName, config.updateRate, config.gaussianNoise) == (
        "base",
        "imu/data",
        100.0,
        0.1,
    )
    assert robot.warnings == ()


def planar(extra: str) -> Robot:
    """Returns a rover that moves in the plane, with further elements."""
    move = '<gazebo><plugin name="p" filename="libgazebo_ros_planar_move.so"/></gazebo>'
    return rover(move + extra)


def heading_of(rotation: tuple[float, float, float, float]) -> float:
    return 2.0 * math.atan2(rotation[2], rotation[3])


def test_an_imu_reports_the_orientation_since_the_start_where_asked_to(
    simulate: MakeSimulation,
) -> None:
    simulation = simulate()
    imu = """<gazebo reference="base"><sensor name="{0}" type="imu"><plugin name="{0}"
    filename="libgazebo_ros_imu_sensor.so"><topicName>{0}</topicName>{1}</plugin></sensor></gazebo>"""
    robot = planar(
        imu.format("world", "")
        + imu.format("start", "<initialOrientationAsReference>true</initialOrientationAsReference>")
        + imu.format("turned", "<rpyOffset>0 0 0.5</rpyOffset>")
    )
    assert robot.warnings == ()
    entity = simulation.add_robot("r", "r", robot, Pose.from_rpy(0, 0, 0.1, 0, 0, 1.0))
    units = [InertialUnit(simulation, entity, config) for config in robot.of(Imu)]
    entity.movers[0].command(simulation.moment, 0.0, 0.0, 0.5)
    run(simulation, 1.0)
    yaw = simulation.pose(entity).yaw
    assert yaw == pytest.approx(1.5, abs=0.05)
    assert [heading_of(unit.measure()[0]) for unit in units] == pytest.approx(
        [yaw, yaw - 1.0, yaw + 0.5], abs=1e-3
    )


def test_ground_truth_in_the_frame_of_a_link_is_relative_to_it(simulate: MakeSimulation) -> None:
    simulation = simulate()
    truth = """<gazebo><plugin name="t" filename="libgazebo_ros_p3d.so"><bodyName>front_left_wheel</bodyName>
    <frameName>{}</frameName></plugin></gazebo>"""
    robot = planar(truth.format("base") + truth.format("/world") + truth.format("odom"))
    [warning] = robot.warnings
    assert "frameName 'odom' is no link of the robot" in warning
    entity = simulation.add_robot("r", "r", robot, Pose.from_rpy(1.0, 2.0, 0.1, 0, 0, 1.0))
    relative, world, other = (Truth(simulation, entity, config) for config in robot.of(GroundTruth))
    assert (relative.reference, world.reference, other.reference) == ("base", None, None)
    entity.movers[0].command(simulation.moment, 0.3, 0.0, 0.5)
    run(simulation, 1.0)
    pose, velocity = relative.motion()
    assert pose.position == pytest.approx((0.15, 0.2, 0.0), abs=1e-3)
    # The wheel moves sideways round the base's centre: turn rate times offset.
    assert velocity.linear == pytest.approx((-0.5 * 0.2, 0.5 * 0.15, 0.0), abs=0.01)
    in_world, _ = world.motion()
    assert in_world == other.motion()[0]
    assert in_world.position == pytest.approx(
        simulation.pose(entity).compose(pose).position, abs=1e-6
    )


def test_covariances_of_drives_are_those_of_the_description() -> None:
    covariances = "<covariance_x>0.5</covariance_x><covariance_yaw>0.25</covariance_yaw>"
    robot = rover(SKID.replace("</plugin>", f"{covariances}</plugin>"))
    assert robot.drives[0].poseCovariance == (0.5, 0.0001, 1e12, 1e12, 1e12, 0.25)
    diagonal = [0.001, 0.001, 1e6, 1e6, 1e6, 0.03]
    [drive] = driven(parameters(pose_covariance_diagonal=diagonal)).drives
    assert drive.poseCovariance == tuple(diagonal)
    assert drive.twistCovariance == (1e-5, 1e-5, 1e12, 1e12, 1e12, 1e-3)
    _, notes = controlled(rover(CONTROL), parameters(twist_covariance_diagonal=[1, 2]))
    assert any("twist_covariance_diagonal is ignored" in note for note in notes)


def test_a_stereo_cameras_baseline_is_in_its_camera_info() -> None:
    robot = rover("""<gazebo reference="base"><sensor type="camera" name="right"><camera>
    <horizontal_fov>1.5708</horizontal_fov><image><width>80</width><height>60</height></image></camera>
    <plugin name="c" filename="libgazebo_ros_camera.so"><hackBaseline>0.07</hackBaseline><distortionK1>0</distortionK1>
    <distortionK2>0.1</distortionK2></plugin></sensor></gazebo>""")
    [camera] = robot.of(Camera)
    assert info_of(camera).P[3] == pytest.approx(-0.07 * 40.0, rel=1e-3)
    [warning] = robot.warnings
    assert "distortionK2" in warning
    assert "no distortion" in warning


def test_models_may_be_called_like_links_and_like_the_world(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    names = ("a", "a::b", "world", "map")
    simulation = simulate(
        *(
            box(name, Pose((float(number), 0.0, 0.1)), (0.2, 0.2, 0.2), static=False)
            for number, name in enumerate(names, start=1)
        )
    )
    for number, name in enumerate(names, start=1):
        for full in (name, f"{name}::link"):
            assert relative(simulation, full, "")[0].position[0] == pytest.approx(number, abs=0.01)
        place(simulation, name, Pose((float(number), 2.0, 0.5)), Velocity(), "world")
        assert simulation.pose(simulation.entity(name)).position[1] == 2.0


def test_a_gps_moves_north_and_east_by_metres(simulate: MakeSimulation) -> None:
    simulation = simulate()
    plugin = """<gazebo><plugin name="gps" filename="libhector_gazebo_ros_gps.so"><bodyName>base</bodyName>
    <referenceLatitude>45</referenceLatitude><referenceLongitude>10</referenceLongitude></plugin></gazebo>"""
    robot = rover(plugin)
    [config] = robot.of(Gps)
    entity = spawned(simulation, robot)
    (latitude, longitude, _), _ = Receiver(simulation, entity, config).measure()
    simulation.place("r", Pose((100.0, -200.0, 0.1)))
    (north, east, height), velocity = Receiver(simulation, entity, config).measure()
    assert (north - latitude) * 111_132 == pytest.approx(100.0, abs=0.5)
    assert (east - longitude) * 78_847 == pytest.approx(200.0, abs=0.7)
    assert height == pytest.approx(0.1, abs=0.01)
    assert velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.1)


@pytest.mark.parametrize("swapped", [False, True])
def test_the_left_wheel_is_where_it_lies_unless_in_legacy_mode(
    simulate: MakeSimulation, swapped: bool
) -> None:
    left, right = ("front_right", "front_left") if swapped else ("front_left", "front_right")
    for mode, way in (
        ("", 1.0),
        ("true", 1.0 if swapped else -1.0),
        ("false", -1.0 if swapped else 1.0),
    ):
        words = f"<legacyMode>{mode}</legacyMode>" if mode else ""
        plugin = f"""<gazebo><plugin name="d" filename="libgazebo_ros_diff_drive.so"><leftJoint>{left}</leftJoint>
        <rightJoint>{right}</rightJoint><wheelSeparation>0.4</wheelSeparation><wheelDiameter>0.2</wheelDiameter>{words}
        </plugin></gazebo>"""
        simulation = simulate()
        entity = spawned(simulation, rover(plugin, smooth=True))
        entity.drives[0].drive.command(0.0, 1.0)
        run(simulation, 1.0)
        assert simulation.pose(entity).yaw * way > 0.02


def test_an_element_that_nothing_reads_is_noted_once() -> None:
    plugin = '<plugin name="{}" filename="libgazebo_ros_planar_move.so"><wings>2</wings></plugin>'
    sensor = """<sensor type="ray" name="s"><ray><scan><horizontal><samples>5</samples><min_angle>-1</min_angle>
    <max_angle>1</max_angle></horizontal></scan><range><min>0.1</min><max>30</max></range></ray>
    <plugin name="p" filename="libgazebo_ros_ray_sensor.so"><ros><remapping>~/out:=scan</remapping></ros>
    <wheels>4</wheels></plugin></sensor>"""
    both = plugin.format("a") + plugin.format("b")
    robot = rover(f'<gazebo>{both}</gazebo><gazebo reference="base">{sensor}</gazebo>')
    assert [line.partition(" of ")[0] for line in robot.warnings] == ["<wings>", "<wheels>"]
    assert robot.lasers[0].topic == "scan"


def test_plugins_and_sensors_of_an_sdf_model_work_as_in_urdf(simulate: MakeSimulation) -> None:
    wheels = "".join(
        f"""<link name='{name}'><pose>0 {y} 0.1 {-math.pi / 2} 0 0</pose>{LIGHT}<collision name='c'><geometry>
        <cylinder><radius>0.1</radius><length>0.04</length></cylinder></geometry></collision></link>
        <joint name='{name}_joint' type='revolute'><parent>base</parent><child>{name}</child>
        <axis><xyz>0 0 1</xyz></axis></joint>"""
        for name, y in (("left", 0.2), ("right", -0.2))
    )
    text = f"""<sdf version='1.6'><model name='cart'><link name='base'><pose>0 0 0.1 0 0 0</pose>{LIGHT}
    <collision name='c'><geometry><box><size>0.3 0.3 0.1</size></box></geometry></collision>
    <collision name='caster'><pose>-0.12 0 -0.06 0 0 0</pose><geometry><sphere><radius>0.04</radius></sphere></geometry>
    <surface><friction><ode><mu>0</mu></ode></friction></surface></collision>
    <sensor name='s' type='ray'><ray><scan><horizontal><samples>9</samples>
    <min_angle>-1</min_angle><max_angle>1</max_angle></horizontal></scan><range><min>0.1</min><max>5</max></range></ray>
    <plugin name='p' filename='libgazebo_ros_laser.so'><topicName>scan</topicName></plugin></sensor></link>{wheels}
    <plugin name='d' filename='libgazebo_ros_diff_drive.so'><leftJoint>left_joint</leftJoint>
    <rightJoint>right_joint</rightJoint><wheelSeparation>0.4</wheelSeparation><wheelDiameter>0.2</wheelDiameter></plugin>
    </model></sdf>"""
    world = world_from_sdf_text(text)
    assert world.warnings == ()
    simulation = simulate()
    simulation.add_model(replace(world.models[0], pose=Pose()))
    entity = simulation.entity("cart")
    run(simulation, 1.0)
    assert np.isinf(simulation.ranges(entity, entity.lasers[0])).all()
    entity.drives[0].drive.command(0.3, 0.0)
    run(simulation, 3.0)
    assert simulation.pose(entity).position[:2] == pytest.approx((0.9, 0.0), abs=0.06)


def test_a_depth_cameras_points_lie_where_the_pixels_look() -> None:
    camera = Camera("c", "l", width=5, height=3, horizontal_fov=math.pi / 2)
    depth = np.full((3, 5), 2.0, np.float32)
    depth[0, 0] = np.inf
    points = points_of(depth, camera)
    np.testing.assert_allclose(points[1, 2], (0.0, 0.0, 2.0))
    assert points[1, 4, 0] == pytest.approx(2.0 * 2.0 / 2.5)
    assert np.isnan(points[0, 0]).all()


CONTROL = """<gazebo><plugin name="c" filename="libgazebo_ros_control.so"><robotNamespace>/rover</robotNamespace>
<robotSimType>gazebo_ros_control/DefaultRobotHWSim</robotSimType></plugin></gazebo>
<transmission name="t"><type>transmission_interface/SimpleTransmission</type></transmission>"""

PARAMETERS = """
joint_states:
  type: joint_state_controller/JointStateController
  publish_rate: 25
base:
  type: diff_drive_controller/DiffDriveController
  left_wheel: [front_left, rear_left]
  right_wheel: [front_right, rear_right]
  wheel_separation: 0.4
  wheel_radius: 0.1
  publish_rate: 40
  cmd_vel_timeout: 1.0
  base_frame_id: base
  enable_odom_tf: false
  linear: {x: {has_velocity_limits: true, max_velocity: 0.6, has_acceleration_limits: true, max_acceleration: 0.4}}
  angular: {z: {has_velocity_limits: true, max_velocity: 1.0, min_velocity: -0.5}}
"""


def parameters(**changed: Any) -> dict[str, Any]:
    values: dict[str, Any] = yaml.safe_load(PARAMETERS)
    values["base"] |= changed
    return {**values, "robot_description": "<robot/>"}


def driven(given: dict[str, Any]) -> Robot:
    robot = rover(CONTROL, smooth=True)
    devices, notes = controlled(robot, given)
    assert not notes
    return replace(robot, devices=devices)


def test_a_diff_drive_controller_is_read_under_ros_controls_names() -> None:
    robot = driven(parameters())
    [drive] = robot.drives
    assert (robot.namespace, robot.warnings) == ("rover", ())
    assert drive.joints() == (("front_left", "rear_left"), ("front_right", "rear_right"))
    assert (drive.commandTopic, drive.odometryTopic) == ("base/cmd_vel", "base/odom")
    assert (drive.wheelSeparation, drive.wheelDiameter, drive.updateRate, drive.commandTimeout) == (
        0.4,
        0.2,
        40,
        1,
    )
    assert (drive.robotBaseFrame, drive.odometryFrame, drive.publishOdomTF) == (
        "base",
        "odom",
        False,
    )
    [states] = robot.of(JointStatePublisher)
    assert (states.updateRate, states.topicName, states.jointName) == (25, "joint_states", ())


def test_separation_and_radius_are_those_of_the_description_where_the_yaml_has_none() -> None:
    given = parameters(
        left_wheel="front_left", right_wheel="front_right", wheel_separation_multiplier=1.5
    )
    del given["base"]["wheel_separation"], given["base"]["wheel_radius"]
    [drive] = driven(given).drives
    assert (drive.wheelSeparation, drive.wheelDiameter) == pytest.approx((0.6, 0.2))


def test_a_controlled_robot_drives_within_its_limits_and_stops_without_commands(
    simulate: MakeSimulation,
) -> None:
    simulation = simulate()
    entity = spawned(simulation, driven(parameters()))
    for _ in range(8):
        entity.drives[0].command(simulation.moment, 3.0, 0.0)
        run(simulation, 0.5)
        assert simulation.odometry(entity.drives[0]).speed < 0.62
    x, y, _ = simulation.pose(entity).position
    # 1.5 s at 0.4 m/s², then 2.5 s at 0.6 m/s.
    assert x == pytest.approx(0.45 + 1.5, abs=0.06)
    assert abs(y) < 0.03
    assert simulation.odometry(entity.drives[0]).speed == pytest.approx(0.6, abs=0.02)
    run(simulation, 3.0)
    assert simulation.odometry(entity.drives[0]).speed == pytest.approx(0.0, abs=1e-3)
    entity.drives[0].command(simulation.moment, 0.0, -2.0)
    run(simulation, 0.8)
    assert simulation.odometry(entity.drives[0]).turn == pytest.approx(-0.5, abs=0.05)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"left_wheel": "frot_left"},
            "base/left_wheel: unknown joint 'frot_left'; did you mean 'front_left'",
        ),
        ({"left_wheel": None}, "base/left_wheel is missing"),
        ({"left_wheel": "front_left"}, "as many left as right wheels"),
        ({"wheel_radius": 0}, "base/wheel_radius is 0 and must be a number > 0"),
        ({"wheel_separation": "wide"}, "base/wheel_separation is 'wide' and must be a number > 0"),
        ({"linear": {"x": {"has_velocity_limits": True}}}, "base/linear/x/max_velocity is missing"),
    ],
)
def test_an_invalid_controller_is_refused_by_its_parameters_name(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(DescriptionError, match=message):
        controlled(rover(CONTROL), parameters(**changed))


def test_what_is_not_supported_is_noted() -> None:
    arm = {"type": "position_controllers/JointTrajectoryController", "joints": ["a"]}
    _, notes = controlled(rover(CONTROL), {**parameters(wings=2), "arm_controller": arm})
    assert [line.split(" ")[0] for line in notes] == ["base/wings", "controller"]
    _, notes = controlled(rover(CONTROL), {"robot_description": "<robot/>"})
    assert "libgazebo_ros_control.so drives nothing" in notes[0]


MECANUM = """
type: mecanum_drive_controller/MecanumDriveController
front_left_wheel_joint: front_left
front_right_wheel_joint: front_right
back_left_wheel_joint: rear_left
back_right_wheel_joint: rear_right
wheel_separation_x: 0.3
wheel_separation_y: 0.3
wheel_radius: 0.1
base_frame_id: base
cmd_vel_timeout: 0.4
enable_odom_tf: false
linear: {y: {has_velocity_limits: true, max_velocity: 0.5, has_acceleration_limits: true, max_acceleration: 1.0}}
"""


def test_a_base_with_mecanum_wheels_moves_sideways_within_its_limits_and_stops_without_commands(
    simulate: MakeSimulation,
) -> None:
    devices, notes = controlled(rover(CONTROL), {"omni": yaml.safe_load(MECANUM)})
    assert notes == []
    [config] = devices
    assert (config.commandTopic, config.odometryTopic, config.robotBaseFrame) == (
        "omni/cmd_vel",
        "omni/odom",
        "base",
    )
    assert (config.publishTf, config.namespace) == (False, "rover")
    simulation = simulate()
    entity = spawned(simulation, replace(rover(CONTROL), devices=devices))
    for _ in range(10):
        entity.movers[0].command(simulation.moment, 0.0, 2.0, 0.0)
        run(simulation, 0.2)
    x, y, _ = simulation.pose(entity).position
    # 0.5 s at 1 m/s², then 1.5 s at 0.5 m/s.
    assert (x, y) == pytest.approx((0.0, 0.125 + 0.75), abs=0.03)
    run(simulation, 2.0)
    assert simulation.velocity(entity).linear[1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("linear", "note"),
    [
        (5, "omni/linear is ignored"),
        ({"y": 5}, "omni/linear/y is ignored"),
        (
            {"y": {"has_acceleration_limits": True, "max_acceleration": 1, "min_acceleration": 2}},
            "omni/linear/y/min_acceleration is ignored",
        ),
        (
            {"y": {"has_velocity_limits": True, "max_velocity": 1, "min_velocity": 3}},
            "omni/linear/y/min_velocity is ignored",
        ),
    ],
)
def test_limits_that_limit_nothing_are_left_out_by_name(linear: Any, note: str) -> None:
    """A lower bound above 0 of the acceleration sped a base up for ever; a number for a group ended the spawner."""
    values = yaml.safe_load(MECANUM) | {"linear": linear}
    [config], notes = controlled(rover(CONTROL), {"omni": values})
    assert [line.partition(":")[0] for line in notes] == [note]
    assert config.leftLimits.towards(1.0, 0.0, 0.1) < 1.0


COB = """
twist_controller: {type: cob_omni_drive_controller/WheelController, timeout: 0.5, wheels: [a, b]}
odometry_controller: {type: cob_omni_drive_controller/OdometryController, publish_rate: 25, frame_id: odom_combined,
  child_frame_id: base_footprint, broadcast_tf: false}
"""


def test_a_care_o_bots_base_has_the_topics_of_its_two_controllers() -> None:
    devices, notes = controlled(rover(CONTROL), yaml.safe_load(COB))
    assert notes == []
    [config] = devices
    assert (config.commandTopic, config.odometryTopic, config.odometryRate) == (
        "twist_controller/command",
        "odometry_controller/odometry",
        25.0,
    )
    assert (config.odometryFrame, config.publishTf, config.commandTimeout) == (
        "odom_combined",
        False,
        0.5,
    )


def test_each_plugin_has_its_own_namespace_and_the_root_is_one() -> None:
    robot = rover("""<gazebo><plugin name="d" filename="libgazebo_ros_skid_steer_drive.so">
    <leftFrontJoint>front_left</leftFrontJoint><rightFrontJoint>front_right</rightFrontJoint>
    <leftRearJoint>rear_left</leftRearJoint><rightRearJoint>rear_right</rightRearJoint>
    <robotNamespace>/base</robotNamespace></plugin><plugin name="t" filename="libgazebo_ros_p3d.so">
    <bodyName>base</bodyName><robotNamespace>/</robotNamespace></plugin>
    <plugin name="j" filename="libgazebo_ros_joint_state_publisher.so"/></gazebo><gazebo reference="base">
    <sensor name="s" type="ray"><ray><scan><horizontal><samples>3</samples><min_angle>-1</min_angle>
    <max_angle>1</max_angle></horizontal></scan><range><min>0.1</min><max>5</max></range></ray>
    <plugin name="p" filename="libgazebo_ros_laser.so"><robotNamespace>sens</robotNamespace></plugin></sensor>
    </gazebo>""")
    assert [device.namespace for device in robot.devices] == ["base", "", None, "sens"]
    assert robot.namespace == "base"


CART = """<model name='cart'><pose>1 2 0 0 0 0</pose>
  <link name='base'><pose>0 0 0.1 0 0 0</pose><inertial><mass>5</mass></inertial>
    <collision name='c'><geometry><box><size>0.3 0.3 0.1</size></box></geometry></collision>
    <sensor name='s' type='ray'><ray><scan><horizontal><samples>9</samples><min_angle>-1</min_angle>
      <max_angle>1</max_angle></horizontal></scan><range><min>0.1</min><max>5</max></range></ray>
      <plugin name='p' filename='libgazebo_ros_laser.so'><topicName>scan</topicName></plugin></sensor></link>
  <link name='mast'><pose>0 0 0.3 0 0 0</pose></link>
  <joint name='turn' type='revolute'><parent>base</parent><child>mast</child><axis><xyz>0 0 1</xyz></axis></joint>
  <plugin name='j' filename='libgazebo_ros_joint_state_publisher.so'><jointName>turn</jointName>
    <robotNamespace>cart</robotNamespace></plugin></model>"""


def test_sensors_and_plugins_of_a_nested_sdf_model_are_those_of_the_outer_one(
    simulate: MakeSimulation,
) -> None:
    outer = (
        "<plugin name='m' filename='libgazebo_ros_p3d.so'><bodyName>cart::base</bodyName></plugin>"
    )
    text = f"<sdf version='1.6'><model name='train'>{CART}{outer}</model></sdf>"
    world = world_from_sdf_text(text)
    assert world.warnings == ()
    [model] = world.models
    laser, states, truth = model.devices
    assert isinstance(laser, LaserSensor)
    assert (laser.link, states.jointName, truth.bodyName) == (
        "cart::base",
        ("cart::turn",),
        "cart::base",
    )
    simulation = simulate()
    simulation.add_model(model)
    entity = simulation.entity("train")
    assert entity.namespace == "cart"
    x, y, _ = (
        simulation.link_pose(entity, "cart::base").compose(entity.lasers[0].device.pose).position
    )
    assert (x, y) == pytest.approx((1.0, 2.0))


BUMPER = """<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
<gazebo reference="base"><sensor type="contact" name="touch"><contact><collision>base_collision</collision></contact>
<plugin name="p" filename="libgazebo_ros_bumper.so"><bumperTopicName>touch</bumperTopicName></plugin></sensor></gazebo>
</robot>"""


def test_a_bumper_publishes_its_contacts_and_that_there_are_none(
    simulate: MakeSimulation, box: Callable[..., Model]
) -> None:
    simulation = simulate(box("wall", Pose((0.5, 0.0, 0.5)), (0.1, 2.0, 1.0)))
    robot = robot_from_urdf(BUMPER)
    entity = simulation.add_robot("r", "r", robot, Pose((0.0, 0.0, 0.5)))
    sent: list[bytes] = []
    published: list[Callable[[int], None]] = []
    port = SimpleNamespace(
        entity=entity,
        simulation=simulation,
        topic=lambda name, kind: SimpleNamespace(send=lambda frame: sent.append(bytes(frame))),
        every=lambda rate, name, task, topic: published.append(task),
    )
    bumper_topics(port, robot.of(Bumper)[0])  # type: ignore[arg-type]
    simulation.place("r", Pose((0.0, 0.0, 0.5)), Velocity((3.0, 0.0, 0.0)))
    for tick in range(0, TICK_RATE, 12):
        simulation.advance(tick)
        published[0](tick)
    states = [ContactsState().deserialize(frame[4:]).states for frame in sent]
    assert states[0] == []
    [touch, *_] = next(filter(None, states))
    assert touch.collision1_name == "r::base::base_collision"
    assert touch.collision2_name.startswith("wall::")


COARSE = """<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
<gazebo reference="base"><sensor type="ray" name="scan"><ray><scan><horizontal><samples>3</samples>
<min_angle>-0.001</min_angle><max_angle>0.001</max_angle></horizontal></scan>
<range><min>0.05</min><max>30</max><resolution>0.5</resolution></range></ray>
<plugin name="p" filename="libgazebo_ros_laser.so"><topicName>scan</topicName></plugin></sensor></gazebo></robot>"""


@pytest.mark.parametrize("distance", [1.0, 1.237, 4.701])
def test_ranges_are_not_rounded_to_the_resolution_of_a_laser(
    simulate: MakeSimulation, box: Callable[..., Model], distance: float
) -> None:
    simulation = simulate(box("wall", Pose((distance + 0.05, 0.0, 0.5)), (0.1, 2.0, 1.0)))
    entity = simulation.add_robot("r", "r", robot_from_urdf(COARSE), Pose((0.0, 0.0, 0.1)))
    ranges = simulation.ranges(entity, entity.lasers[0])
    assert ranges == pytest.approx(distance, abs=1e-4)
