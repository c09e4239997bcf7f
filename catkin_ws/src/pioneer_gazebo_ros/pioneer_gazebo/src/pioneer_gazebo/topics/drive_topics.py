"""Topics of drives: commands, odometry and its transform."""

from collections.abc import Callable

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64, Float64MultiArray

from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.ros import messages
from pioneer_gazebo.simulation.entity import Driven
from pioneer_gazebo.simulation.schedule import nanoseconds
from pioneer_gazebo.topics import drive_messages
from pioneer_gazebo.topics.port import Port
from pioneer_gazebo.topics.sensor_topics import joint_state_topics
from pioneer_gazebo.world.pose import Pose, planar_pose
from pioneer_gazebo.world.robot import (
    ODOMETRY_COVARIANCE,
    DiffDrive,
    JointControl,
    JointStatePublisher,
    PlanarMove,
)


def _wheel_transforms(port: Port, driven: Driven) -> None:
    """Publishes the transforms of the driven wheels relative to their parent links."""
    body, simulation, transforms = port.entity.body, port.simulation, port.context.transforms
    wheels = []
    for part in driven.parts:
        joint = body.parts[part].joint
        assert joint is not None, "a wheel has a joint"
        wheels.append(
            (
                joint,
                messages.TransformTemplate(port.frame(joint.parent), port.frame(joint.child)),
            )
        )

    def publish(tick: int) -> None:
        for joint, template in wheels:
            parent = simulation.link_pose(port.entity, joint.parent)
            child = simulation.link_pose(port.entity, joint.child)
            transforms.add(template.fill(nanoseconds(tick), parent.inverse().compose(child)))

    port.every(driven.drive.config.updateRate, "wheels", publish, transforms=True)


def true_motion(port: Port) -> tuple[Pose, Velocity]:
    """Returns the robot's true pose, and its velocity in its own axes."""
    pose = port.simulation.pose(port.entity)
    return pose, port.simulation.velocity(port.entity).seen_from(pose.rotation)


def odometry_topics(
    port: Port,
    config: DiffDrive | PlanarMove,
    rate: float,
    motion: Callable[[], tuple[Pose, Velocity]],
    tf: bool = True,
) -> None:
    """Publishes ``motion`` on ``odometryTopic`` (Odometry) at ``rate`` [Hz] and, if ``tf``, its transform."""
    transforms, topic = port.context.transforms, port.topic(config.odometryTopic, Odometry)
    odom, base = port.frame(config.odometryFrame), port.frame(config.robotBaseFrame)
    diagonals = (ODOMETRY_COVARIANCE, ODOMETRY_COVARIANCE)
    if isinstance(config, DiffDrive):
        diagonals = (config.poseCovariance, config.twistCovariance)
    template = drive_messages.OdometryTemplate(odom, base, *diagonals)
    transform = messages.TransformTemplate(odom, base)

    def publish(tick: int) -> None:
        time = nanoseconds(tick)
        pose, velocity = motion()
        if topic.wanted:
            topic.send(template.fill(time, pose, velocity))
        if tf and transforms.wanted:
            transforms.add(transform.fill(time, pose))

    port.every(rate, config.odometryTopic, publish, topic, transforms=tf)


def drive_topics(port: Port, config: DiffDrive) -> None:
    """Subscribes to ``commandTopic`` (Twist); publishes ``odometryTopic`` (Odometry) and its transform."""
    driven = port.entity.driven(config)

    def believed() -> tuple[Pose, Velocity]:
        state = port.simulation.odometry(driven)
        pose = planar_pose(state.x, state.y, state.yaw)
        return pose, Velocity((state.speed, 0.0, 0.0), (0.0, 0.0, state.turn))

    def command(message: Twist) -> None:
        driven.command(port.context.now(), message.linear.x, message.angular.z)

    motion = believed if config.odometrySource != "world" else lambda: true_motion(port)
    odometry_topics(
        port, config, config.updateRate, motion, config.publishTf and config.publishOdomTF
    )
    if config.publishWheelTF:
        _wheel_transforms(port, driven)
    if config.publishWheelJointState:
        names = tuple(joint for side in config.joints() for joint in side)
        joint_state_topics(port, JointStatePublisher(config.name, names, config.updateRate))
    port.take_commands(config.commandTopic, Twist, command)


def planar_topics(port: Port, config: PlanarMove) -> None:
    """Subscribes to ``commandTopic`` (Twist); publishes the true pose on ``odometryTopic`` (Odometry) and ``/tf``."""
    mover = next(one for one in port.entity.movers if one.config is config)

    def command(message: Twist) -> None:
        mover.command(port.context.now(), message.linear.x, message.linear.y, message.angular.z)

    odometry_topics(port, config, config.odometryRate, lambda: true_motion(port), config.publishTf)
    port.take_commands(config.commandTopic, Twist, command)


def joint_topics(port: Port, config: JointControl) -> None:
    """Subscribes to ``NAME/command``: a Float64 for a joint, a Float64MultiArray for a group of joints."""
    motors = next(one for one in port.entity.motors if one.config is config)

    def command(message: Float64) -> None:
        motors.command(port.context.now(), [message.data])

    def group_command(message: Float64MultiArray) -> None:
        motors.command(port.context.now(), message.data)

    topic = f"{config.name}/command"
    if config.isGroup:
        port.take_commands(topic, Float64MultiArray, group_command)
    else:
        port.take_commands(topic, Float64, command)
