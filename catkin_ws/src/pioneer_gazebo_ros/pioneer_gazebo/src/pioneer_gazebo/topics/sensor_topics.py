"""Topics of sensors, and of what a real Pioneer's driver reports: battery, bumpers, motors, sonar ring."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from gazebo_msgs.msg import ContactsState, ContactState
from geometry_msgs.msg import Point32, Quaternion, Vector3, Vector3Stamped, Wrench
from nav_msgs.msg import Odometry
from pioneer_msgs.msg import BumperState
from sensor_msgs.msg import (
    BatteryState,
    CameraInfo,
    Image,
    JointState,
    LaserScan,
    NavSatFix,
    NavSatStatus,
    PointCloud,
    PointCloud2,
    Range,
)
from sensor_msgs.msg import Imu as ImuMessage
from std_msgs.msg import Bool, Float32, Float64, Int8

from pioneer_gazebo.physics.engine import Contact
from pioneer_gazebo.ros import messages
from pioneer_gazebo.ros.topic import Topic
from pioneer_gazebo.sensors.base import Battery, pressed_bumpers, sonar_points, wheels_of
from pioneer_gazebo.sensors.camera import noisy, points_of
from pioneer_gazebo.sensors.inertial import InertialUnit, Receiver, Truth
from pioneer_gazebo.simulation.schedule import nanoseconds
from pioneer_gazebo.topics import drive_messages, sensor_messages
from pioneer_gazebo.topics.port import Port
from pioneer_gazebo.world.robot import (
    BaseDriver,
    Bumper,
    Camera,
    Gps,
    GroundTruth,
    Imu,
    JointStatePublisher,
    LaserSensor,
    SonarSensor,
)
from pioneer_node.core.frame import stripped


def laser_topics(port: Port, config: LaserSensor) -> None:
    """Publishes a laser's scans (LaserScan)."""
    mounted = port.entity.mounted(config)
    template = sensor_messages.ScanTemplate(config, port.frame(config.frame), mounted.laser)

    def frame(time: int) -> bytearray:
        return template.fill(time, port.simulation.ranges(port.entity, mounted))

    port.stream(config.topic, LaserScan, config.update_rate, frame)


def sonar_topics(port: Port, config: SonarSensor) -> None:
    """Publishes a sonar's readings (Range)."""
    mounted = port.entity.mounted(config)
    template = sensor_messages.RangeTemplate(config, port.frame(config.frame))

    def frame(time: int) -> bytearray:
        return template.fill(time, port.simulation.distance(port.entity, mounted))

    port.stream(config.topic, Range, config.update_rate, frame)


def truth_topics(port: Port, config: GroundTruth) -> None:
    """Publishes a link's true pose and velocity (Odometry), in the world or relative to another link."""
    variance = [config.gaussianNoise**2] * 6
    truth = Truth(port.simulation, port.entity, config)
    frame = stripped(config.frameName) if truth.reference is None else port.frame(truth.reference)
    template = drive_messages.OdometryTemplate(
        frame, port.frame(config.bodyName), variance, variance
    )
    port.stream(
        config.topicName,
        Odometry,
        config.updateRate,
        lambda time: template.fill(time, *truth.motion()),
    )


def joint_state_topics(port: Port, config: JointStatePublisher) -> None:
    """Publishes positions and speeds of joints (JointState)."""
    body = port.entity.body
    movable = [part.joint.name for part in body.parts if part.joint is not None]
    names = [name for name in config.jointName if name in movable] or movable
    parts = [body.joint_index(name) for name in names]
    template = sensor_messages.JointStateTemplate(names)

    def frame(time: int) -> bytearray:
        return template.fill(time, port.simulation.joints(port.entity, parts))

    port.stream(config.topicName, JointState, config.updateRate, frame)


def bumper_topics(port: Port, config: Bumper) -> None:
    """Publishes a link's contacts (ContactsState), also that there are none."""
    topic = port.topic(config.bumperTopicName, ContactsState)
    part, _ = port.entity.body.part_of(config.link)
    own = f"{port.entity.name}::{config.link}::{config.collision or config.link}"
    state = partial(_contact_state, port, own)

    def publish(tick: int) -> None:
        contacts = [
            one
            for one in port.simulation.contacts(port.entity)
            if one.part == part and one.force > 0
        ]
        message = ContactsState(states=[state(one) for one in contacts])
        topic.send(messages.stamped_frame(message, nanoseconds(tick), stripped(config.frameName)))

    port.every(config.update_rate, config.bumperTopicName, publish, topic)


def _contact_state(port: Port, own: str, contact: Contact) -> ContactState:
    force = Wrench(Vector3(*(contact.force * part for part in contact.normal)), Vector3())
    return ContactState(
        info=f"depth {contact.depth:.4f} m, force {contact.force:.2f} N",
        collision1_name=own,
        collision2_name=port.simulation.touched_name(contact),
        wrenches=[force],
        total_wrench=force,
        contact_positions=[Vector3(*contact.position)],
        contact_normals=[Vector3(*contact.normal)],
        depths=[contact.depth],
    )


def camera_topics(port: Port, config: Camera) -> None:
    """Publishes ``image_raw`` (Image) and ``camera_info`` (CameraInfo) below the camera's name, with equal stamps.

    A depth camera also publishes depth (Image, 32FC1) with a ``camera_info``, and points (PointCloud2). The simulation
    waits for each image; if rendering takes too much time, images are dropped (`Budget`).
    """
    simulation, frame = port.simulation, port.frame(config.frame)
    noise = simulation.noise(port.entity, config)
    image = port.topic(f"{config.name}/{config.image_topic}", Image)
    infos = [
        port.topic(f"{config.name}/{name}", CameraInfo)
        for name in (config.info_topic, config.depth_info_topic)
        if name
    ]
    intrinsics = sensor_messages.info_of(config)

    depth = port.topic(f"{config.name}/{config.depth_topic}", Image) if config.depth_topic else None
    cloud = (
        port.topic(f"{config.name}/{config.cloud_topic}", PointCloud2)
        if config.cloud_topic
        else None
    )

    def send(topic: Topic | None, tick: int, make: Callable[[], Any]) -> None:
        if topic is not None and topic.wanted:
            topic.send(messages.stamped_frame(make(), nanoseconds(tick), frame))

    def publish_image(tick: int) -> None:
        def draw() -> None:
            eye = simulation.link_pose(port.entity, config.link).compose(config.pose)
            moving = [(entity, simulation.part_poses(entity)) for entity in simulation.entities()]
            picture, far = port.context.renderer().picture(
                config, eye, simulation.standing.values(), moving
            )
            seen = noisy(picture, config.noise_stddev, noise.at(tick))
            send(image, tick, lambda: sensor_messages.image_of(seen, config))
            send(depth, tick, lambda: sensor_messages.depth_of(far))
            send(cloud, tick, lambda: sensor_messages.cloud_of(points_of(far, config)))

        port.context.budget.draw(f"{port.entity.name}/{config.name}", draw)

    def publish_info(tick: int) -> None:
        for info in infos:
            send(info, tick, lambda: intrinsics)

    port.every(
        config.update_rate, config.image_topic, publish_image, *filter(None, (image, depth, cloud))
    )
    port.every(config.update_rate, config.info_topic, publish_info, *infos)


def imu_topics(port: Port, config: Imu) -> None:
    """Publishes a link's orientation, angular rates and acceleration (Imu)."""
    unit = InertialUnit(port.simulation, port.entity, config)
    message = ImuMessage()
    frame_id = port.frame(config.frame)
    variance = config.gaussianNoise**2
    for covariance in (message.angular_velocity_covariance, message.linear_acceleration_covariance):
        covariance[0] = covariance[4] = covariance[8] = variance

    def frame(time: int) -> bytearray:
        rotation, rates, felt = unit.measure()
        message.orientation = Quaternion(*rotation)
        message.angular_velocity, message.linear_acceleration = Vector3(*rates), Vector3(*felt)
        return messages.stamped_frame(message, time, frame_id)

    port.stream(config.topicName, ImuMessage, config.updateRate, frame)


def gps_topics(port: Port, config: Gps) -> None:
    """Publishes a link's geodetic position (NavSatFix) and its velocity to north, west and up (Vector3Stamped)."""
    fixes = port.topic(config.topicName, NavSatFix)
    velocities = port.topic(config.velocityTopicName, Vector3Stamped)
    receiver = Receiver(port.simulation, port.entity, config)
    status = NavSatStatus(NavSatStatus.STATUS_FIX, NavSatStatus.SERVICE_GPS)

    def publish(tick: int) -> None:
        (latitude, longitude, altitude), velocity = receiver.measure()
        fix = NavSatFix(status=status, latitude=latitude, longitude=longitude, altitude=altitude)
        moving = Vector3Stamped(vector=Vector3(*velocity))
        for topic, message in ((fixes, fix), (velocities, moving)):
            if topic.wanted:
                topic.send(messages.stamped_frame(message, nanoseconds(tick), config.frameId))

    port.every(config.updateRate, config.topicName, publish, fixes, velocities)


NOT_CHARGING = 0
"""A value of rosaria's ``battery_recharge_state``."""


def driver_topics(port: Port, config: BaseDriver) -> None:
    """Publishes the base data of one robot.

    ``battery_state`` (sensor_msgs/BatteryState), ``battery_voltage`` (std_msgs/Float64), ``battery_state_of_charge``
    (std_msgs/Float32, 0 … 1), ``battery_recharge_state`` (std_msgs/Int8, latched), ``motors_state`` (std_msgs/Bool,
    latched), ``bumper_state`` (pioneer_msgs/BumperState) and, if the robot has sonars, ``sonar``
    (sensor_msgs/PointCloud). The battery drains whether or not there are subscribers.
    """
    simulation, entity, frame = port.simulation, port.entity, port.frame(config.frameName)
    battery = Battery(config)
    drained = [simulation.tick]

    def bumper_state() -> BumperState:
        front, rear = pressed_bumpers(simulation, entity)
        return BumperState(front_bumpers=front, rear_bumpers=rear)

    def cloud() -> PointCloud:
        return PointCloud(points=[Point32(*one) for one in sonar_points(simulation, entity)])

    makers: list[tuple[str, type, Callable[[], Any]]] = [
        ("battery_state", BatteryState, lambda: battery_state(battery)),
        ("battery_voltage", Float64, lambda: Float64(battery.voltage)),
        ("battery_state_of_charge", Float32, lambda: Float32(battery.charge)),
        ("bumper_state", BumperState, bumper_state),
    ]
    if entity.sonars:
        makers.append(("sonar", PointCloud, cloud))
    topics = [(port.topic(name, kind), make) for name, kind, make in makers]

    def update(tick: int) -> None:
        time = nanoseconds(tick)
        battery.drain((time - nanoseconds(drained[0])) * 1e-9, wheels_of(simulation, entity))
        drained[0] = tick
        for topic, make in topics:
            if topic.wanted:
                topic.send(messages.stamped_frame(make(), time, frame))

    def reset() -> None:
        battery.reset()
        drained[0] = simulation.tick

    port.on_reset.append(reset)
    port.every(config.updateRate, config.name, update, always=True)
    port.latched("battery_recharge_state", Int8(NOT_CHARGING))
    port.latched("motors_state", Bool(True))


def battery_state(battery: Battery) -> BatteryState:
    """Returns the BatteryState of a battery, without a header."""
    config = battery.config
    return BatteryState(
        voltage=battery.voltage,
        current=-battery.current,
        charge=battery.charge * config.capacity,
        capacity=config.capacity,
        design_capacity=config.capacity,
        percentage=battery.charge,
        power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
        power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_UNKNOWN,
        present=True,
        temperature=math.nan,
    )
