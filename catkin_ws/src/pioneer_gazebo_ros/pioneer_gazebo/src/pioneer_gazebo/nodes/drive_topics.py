"""Topics of drives: commands, odometry and its transform."""

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from pioneer_gazebo import conversions
from pioneer_gazebo.core.engine import Velocity
from pioneer_gazebo.core.entity import Driven
from pioneer_gazebo.core.pose import planar_pose
from pioneer_gazebo.core.robot import DiffDrive, JointStatePublisher
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.nodes.port import Port
from pioneer_gazebo.nodes.sensor_topics import joint_state_topics


def _wheel_transforms(port: Port, driven: Driven) -> None:
    """Publishes the transforms of the driven wheels, from the links that carry them."""
    body, simulation, transforms = port.entity.body, port.simulation, port.context.transforms
    wheels = []
    for part in driven.parts:
        joint = body.parts[part].joint
        assert joint is not None, "a wheel has a joint"
        wheels.append((joint, conversions.TransformTemplate(port.frame(joint.parent), port.frame(joint.child))))

    def publish(tick: int) -> None:
        for joint, template in wheels:
            parent = simulation.link_pose(port.entity, joint.parent)
            child = simulation.link_pose(port.entity, joint.child)
            transforms.add(template.fill(nanoseconds(tick), parent.inverse().compose(child)))

    port.every(driven.drive.config.updateRate, "wheels", publish, transforms=True)


def drive_topics(port: Port, config: DiffDrive) -> None:
    """Subscribes to ``commandTopic`` (Twist); publishes ``odometryTopic`` (Odometry) and its transform."""
    driven, simulation, transforms = port.entity.driven(config), port.simulation, port.context.transforms
    topic = port.topic(config.odometryTopic, Odometry)
    odom, base = port.frame(config.odometryFrame), port.frame(config.robotBaseFrame)
    template = conversions.OdometryTemplate(odom, base, conversions.POSE_COVARIANCE)
    transform = conversions.TransformTemplate(odom, base)
    sends_transform = config.publishTf and config.publishOdomTF
    of_world = config.odometrySource == "world"

    def publish(tick: int) -> None:
        time = nanoseconds(tick)
        if of_world:
            pose = simulation.pose(port.entity)
            velocity = simulation.velocity(port.entity).seen_from(pose.rotation)
        else:
            state = simulation.odometry(driven)
            pose = planar_pose(state.x, state.y, state.yaw)
            velocity = Velocity((state.speed, 0.0, 0.0), (0.0, 0.0, state.turn))
        if topic.wanted:
            topic.send(template.fill(time, pose, velocity))
        if sends_transform and transforms.wanted:
            transforms.add(transform.fill(time, pose))

    def command(message: Twist) -> None:
        driven.command(port.context.now(), message.linear.x, message.angular.z)

    port.every(config.updateRate, config.odometryTopic, publish, topic, transforms=sends_transform)
    if config.publishWheelTF:
        _wheel_transforms(port, driven)
    if config.publishWheelJointState:
        names = tuple(joint for side in config.joints() for joint in side)
        joint_state_topics(port, JointStatePublisher(config.name, names, config.updateRate))
    port.take_commands(config.commandTopic, Twist, command)
