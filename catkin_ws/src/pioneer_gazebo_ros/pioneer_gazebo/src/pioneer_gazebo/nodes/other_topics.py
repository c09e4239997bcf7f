"""Topics of devices that the Pioneer does not have: planar move, IMU, GPS."""

from geometry_msgs.msg import Quaternion, Twist, Vector3, Vector3Stamped
from sensor_msgs.msg import Imu as ImuMessage
from sensor_msgs.msg import NavSatFix, NavSatStatus

from pioneer_gazebo import conversions
from pioneer_gazebo.core.device import Gps, Imu, PlanarMove
from pioneer_gazebo.core.inertial import InertialUnit, Receiver
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.nodes.drive_topics import odometry_topics, true_motion
from pioneer_gazebo.nodes.port import Port


def planar_topics(port: Port, config: PlanarMove) -> None:
    """Subscribes to ``commandTopic`` (Twist); publishes the true pose on ``odometryTopic`` (Odometry) and ``/tf``."""
    mover = next(one for one in port.entity.movers if one.config is config)

    def command(message: Twist) -> None:
        mover.command(port.context.now(), message.linear.x, message.linear.y, message.angular.z)

    odometry_topics(port, config, config.odometryRate, lambda: true_motion(port))
    port.take_commands(config.commandTopic, Twist, command)


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
        return conversions.stamped_frame(message, time, frame_id)

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
                topic.send(conversions.stamped_frame(message, nanoseconds(tick), config.frameId))

    port.every(config.updateRate, config.topicName, publish, fixes, velocities)
