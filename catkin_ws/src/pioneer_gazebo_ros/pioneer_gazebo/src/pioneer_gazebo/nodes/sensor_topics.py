"""Topics of sensors: lasers, sonars, bumpers, joint states, ground truth."""

from functools import partial

from gazebo_msgs.msg import ContactsState, ContactState
from geometry_msgs.msg import Vector3, Wrench
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, LaserScan, Range

from pioneer_gazebo import conversions
from pioneer_gazebo.core.engine import Contact
from pioneer_gazebo.core.robot import Bumper, GroundTruth, JointStatePublisher, LaserSensor, SonarSensor
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.core.truth import Truth
from pioneer_gazebo.nodes.port import Port
from pioneer_node.core.frame import stripped


def laser_topics(port: Port, config: LaserSensor) -> None:
    """Publishes a laser's scans (LaserScan)."""
    mounted = port.entity.mounted(config)
    template = conversions.ScanTemplate(config, port.frame(config.frame), mounted.laser.increment)

    def frame(time: int) -> bytearray:
        return template.fill(time, port.simulation.ranges(port.entity, mounted))

    port.stream(config.topic, LaserScan, config.update_rate, frame)


def sonar_topics(port: Port, config: SonarSensor) -> None:
    """Publishes a sonar's readings (Range)."""
    mounted = port.entity.mounted(config)
    template = conversions.RangeTemplate(config, port.frame(config.frame))

    def frame(time: int) -> bytearray:
        return template.fill(time, port.simulation.distance(port.entity, mounted))

    port.stream(config.topic, Range, config.update_rate, frame)


def truth_topics(port: Port, config: GroundTruth) -> None:
    """Publishes a link's true pose and velocity (Odometry)."""
    variance = [config.gaussianNoise**2] * 6
    template = conversions.OdometryTemplate(stripped(config.frameName), port.frame(config.bodyName), variance)
    truth = Truth(port.simulation, port.entity, config)
    port.stream(config.topicName, Odometry, config.updateRate, lambda time: template.fill(time, *truth.motion()))


def joint_state_topics(port: Port, config: JointStatePublisher) -> None:
    """Publishes positions and speeds of joints (JointState)."""
    body = port.entity.body
    movable = [part.joint.name for part in body.parts if part.joint is not None]
    names = [name for name in config.jointName if name in movable] or movable
    parts = [body.joint_index(name) for name in names]
    template = conversions.JointStateTemplate(names)

    def frame(time: int) -> bytearray:
        return template.fill(time, port.simulation.joints(port.entity, parts))

    port.stream(config.topicName, JointState, config.updateRate, frame)


def bumper_topics(port: Port, config: Bumper) -> None:
    """Publishes a link's contacts (ContactsState) while there are any."""
    topic = port.topic(config.bumperTopicName, ContactsState)
    part, _ = port.entity.body.part_of(config.link)
    own = f"{port.entity.name}::{config.link}::{config.collision or config.link}"
    state = partial(_contact_state, port, own)

    def publish(tick: int) -> None:
        contacts = [one for one in port.simulation.contacts(port.entity) if one.part == part and one.force > 0]
        if contacts:
            message = ContactsState(states=[state(one) for one in contacts])
            topic.send(conversions.stamped_frame(message, nanoseconds(tick), stripped(config.frameName)))

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
