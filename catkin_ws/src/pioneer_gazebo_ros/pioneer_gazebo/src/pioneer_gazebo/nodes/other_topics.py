"""Topics of devices that the Pioneer does not have: planar moves, IMU, GPS."""

import rospy
from geometry_msgs.msg import Quaternion, Twist, Vector3, Vector3Stamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu as ImuMessage
from sensor_msgs.msg import NavSatFix, NavSatStatus

from pioneer_gazebo import conversions
from pioneer_gazebo.core.device import Gps, Imu, PlanarMove
from pioneer_gazebo.core.inertial import InertialUnit, Receiver
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.nodes.port import Port


def planar_topics(port: Port, config: PlanarMove) -> None:
    """Subscribes to ``commandTopic`` (Twist); publishes the true pose on ``odometryTopic`` (Odometry) and ``/tf``."""
    mover = next(one for one in port.entity.movers if one.config is config)
    simulation, transforms = port.simulation, port.context.transforms
    topic = port.topic(config.odometryTopic, Odometry)
    odom, base = port.frame(config.odometryFrame), port.frame(config.robotBaseFrame)
    template = conversions.OdometryTemplate(odom, base, conversions.POSE_COVARIANCE)
    transform = conversions.TransformTemplate(odom, base)

    def publish(tick: int) -> None:
        pose = simulation.pose(port.entity)
        if topic.wanted:
            velocity = simulation.velocity(port.entity).seen_from(pose.rotation)
            topic.send(template.fill(nanoseconds(tick), pose, velocity))
        if transforms.wanted:
            transforms.add(transform.fill(nanoseconds(tick), pose))

    def command(message: Twist) -> None:
        mover.command(port.context.now(), message.linear.x, message.linear.y, message.angular.z)

    port.every(config.odometryRate, config.odometryTopic, publish, topic, transforms=True)
    port.take_commands(config.commandTopic, Twist, command)


def imu_topics(port: Port, config: Imu) -> None:
    """Publishes a link's rotation, rates and accelerations (Imu)."""
    topic = port.topic(config.topicName, ImuMessage)
    unit = InertialUnit(port.simulation, port.entity, config)
    message = ImuMessage()
    message.header.frame_id = port.frame(config.frame)
    variance = config.gaussianNoise**2
    for covariance in (message.angular_velocity_covariance, message.linear_acceleration_covariance):
        covariance[0] = covariance[4] = covariance[8] = variance

    def publish(tick: int) -> None:
        rotation, rates, felt = unit.measure()
        message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
        message.orientation = Quaternion(*rotation)
        message.angular_velocity, message.linear_acceleration = Vector3(*rates), Vector3(*felt)
        topic.send(conversions.frame_of(message))

    port.every(config.updateRate, config.topicName, publish, topic)


def gps_topics(port: Port, config: Gps) -> None:
    """Publishes a link's place on the globe (NavSatFix) and its velocity to north, west and up (Vector3Stamped)."""
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
                message.header.frame_id = config.frameId
                message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
                topic.send(conversions.frame_of(message))

    port.every(config.updateRate, config.topicName, publish, fixes, velocities)
