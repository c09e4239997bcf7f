"""Topics of sensors: lasers, sonars, bumpers, joint states, ground truth."""

from functools import partial

import rospy
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
    topic = port.topic(config.topic, LaserScan)
    template = conversions.ScanTemplate(config, port.frame(config.frame), mounted.laser.increment)

    def publish(tick: int) -> None:
        topic.send(template.fill(nanoseconds(tick), port.simulation.ranges(port.entity, mounted)))

    port.every(config.update_rate, config.topic, publish, topic)


def sonar_topics(port: Port, config: SonarSensor) -> None:
    """Publishes a sonar's readings (Range)."""
    mounted = port.entity.mounted(config)
    topic = port.topic(config.topic, Range)
    template = conversions.RangeTemplate(config, port.frame(config.frame))

    def publish(tick: int) -> None:
        topic.send(template.fill(nanoseconds(tick), port.simulation.distance(port.entity, mounted)))

    port.every(config.update_rate, config.topic, publish, topic)


def truth_topics(port: Port, config: GroundTruth) -> None:
    """Publishes a link's true pose and velocity (Odometry)."""
    topic = port.topic(config.topicName, Odometry)
    variance = [config.gaussianNoise**2] * 6
    template = conversions.OdometryTemplate(stripped(config.frameName), port.frame(config.bodyName), variance)
    truth = Truth(port.simulation, port.entity, config)

    def publish(tick: int) -> None:
        topic.send(template.fill(nanoseconds(tick), *truth.motion()))

    port.every(config.updateRate, config.topicName, publish, topic)


def joint_state_topics(port: Port, config: JointStatePublisher) -> None:
    """Publishes positions and speeds of joints (JointState)."""
    topic = port.topic(config.topicName, JointState)
    body = port.entity.body
    movable = [part.joint.name for part in body.parts if part.joint is not None]
    names = [name for name in config.jointName if name in movable] or movable
    parts = [body.joint_index(name) for name in names]
    template = conversions.JointStateTemplate(names)

    def publish(tick: int) -> None:
        topic.send(template.fill(nanoseconds(tick), port.simulation.joints(port.entity, parts)))

    port.every(config.updateRate, config.topicName, publish, topic)


def bumper_topics(port: Port, config: Bumper) -> None:
    """Publishes the contacts of a link (ContactsState) while there are any."""
    topic = port.topic(config.bumperTopicName, ContactsState)
    part, _ = port.entity.body.part_of(config.link)
    message = ContactsState()
    message.header.frame_id = stripped(config.frameName)
    own = f"{port.entity.name}::{config.link}::{config.collision or config.link}"
    state = partial(_contact_state, port, own)

    def publish(tick: int) -> None:
        contacts = [one for one in port.simulation.contacts(port.entity) if one.part == part and one.force > 0]
        if contacts:
            message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
            message.states = [state(one) for one in contacts]
            topic.send(conversions.frame_of(message))

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
