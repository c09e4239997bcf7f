"""A bridge from ROS 1 to ROS 2 written in the usual way: each message becomes an object of rospy, then one of rclpy.

`bridge.py JSON` runs it, JSON being a list of `[TOPIC, ROS2_TOPIC, TYPE, QOS, OWN_FRAMES]`; `bridge.py convert FILE`
prints the least CPU time of converting the message in FILE (type on the first line, then ROS 1's bytes).

The bridge is written as one writes it with care: numbers are handed over as arrays, which rclpy does not check one by
one. It reads all its topics, whether or not anybody reads them in ROS 2.
"""

import array
import json
import os
import sys
import time
from typing import Any

import geometry_msgs.msg as geometry2
import nav_msgs.msg as nav2
import rclpy
import rosgraph_msgs.msg as rosgraph2
import sensor_msgs.msg as sensor2
from debian import imported
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

rospy, geometry1, nav1, rosgraph1, sensor1 = imported(
    "rospy", "geometry_msgs.msg", "nav_msgs.msg", "rosgraph_msgs.msg", "sensor_msgs.msg"
)
REPETITIONS = 5
LONG_ENOUGH = 0.1
"""CPU time over which conversions are repeated [s]."""
PROFILES = {
    "sensor": QoSProfile(depth=1),
    "reliable": QoSProfile(depth=10),
    "latched": QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}


def _copy_time(old: Any, new: Any) -> None:
    new.sec = old.secs
    new.nanosec = old.nsecs


def _copy_header(old: Any, new: Any) -> None:
    _copy_time(old.stamp, new.stamp)
    new.frame_id = old.frame_id


def _copy_vector(old: Any, new: Any) -> None:
    new.x = old.x
    new.y = old.y
    new.z = old.z


def _copy_pose(old: Any, new: Any) -> None:
    _copy_vector(old.position, new.position)
    _copy_vector(old.orientation, new.orientation)
    new.orientation.w = old.orientation.w


def _clock(old: Any) -> Any:
    new = rosgraph2.Clock()
    _copy_time(old.clock, new.clock)
    return new


def _scan(old: Any) -> Any:
    new = sensor2.LaserScan()
    _copy_header(old.header, new.header)
    new.angle_min = old.angle_min
    new.angle_max = old.angle_max
    new.angle_increment = old.angle_increment
    new.time_increment = old.time_increment
    new.scan_time = old.scan_time
    new.range_min = old.range_min
    new.range_max = old.range_max
    # An array is taken as it is; of a list, rclpy would check each number.
    new.ranges = array.array("f", old.ranges)
    new.intensities = array.array("f", old.intensities)
    return new


def _image(old: Any) -> Any:
    new = sensor2.Image()
    _copy_header(old.header, new.header)
    new.height = old.height
    new.width = old.width
    new.encoding = old.encoding
    new.is_bigendian = old.is_bigendian
    new.step = old.step
    new.data = array.array("B", old.data)
    return new


def _joints(old: Any) -> Any:
    new = sensor2.JointState()
    _copy_header(old.header, new.header)
    new.name = list(old.name)
    new.position = array.array("d", old.position)
    new.velocity = array.array("d", old.velocity)
    new.effort = array.array("d", old.effort)
    return new


def _odometry(old: Any) -> Any:
    new = nav2.Odometry()
    _copy_header(old.header, new.header)
    new.child_frame_id = old.child_frame_id
    _copy_pose(old.pose.pose, new.pose.pose)
    new.pose.covariance = list(old.pose.covariance)
    _copy_vector(old.twist.twist.linear, new.twist.twist.linear)
    _copy_vector(old.twist.twist.angular, new.twist.twist.angular)
    new.twist.covariance = list(old.twist.covariance)
    return new


def _stamped_pose(old: Any) -> Any:
    new = geometry2.PoseStamped()
    _copy_header(old.header, new.header)
    _copy_pose(old.pose, new.pose)
    return new


def _estimate(old: Any) -> Any:
    new = geometry2.PoseWithCovarianceStamped()
    _copy_header(old.header, new.header)
    _copy_pose(old.pose.pose, new.pose.pose)
    new.pose.covariance = list(old.pose.covariance)
    return new


def _particles(old: Any) -> Any:
    new = geometry2.PoseArray()
    _copy_header(old.header, new.header)
    poses = []
    for pose in old.poses:
        poses.append(geometry2.Pose())
        _copy_pose(pose, poses[-1])
    new.poses = poses
    return new


def _path(old: Any) -> Any:
    new = nav2.Path()
    _copy_header(old.header, new.header)
    new.poses = [_stamped_pose(pose) for pose in old.poses]
    return new


def _grid(old: Any) -> Any:
    new = nav2.OccupancyGrid()
    _copy_header(old.header, new.header)
    _copy_time(old.info.map_load_time, new.info.map_load_time)
    new.info.resolution = old.info.resolution
    new.info.width = old.info.width
    new.info.height = old.info.height
    _copy_pose(old.info.origin, new.info.origin)
    new.data = array.array("b", old.data)
    return new


def _polygon(old: Any) -> Any:
    new = geometry2.PolygonStamped()
    _copy_header(old.header, new.header)
    points = []
    for point in old.polygon.points:
        points.append(geometry2.Point32())
        _copy_vector(point, points[-1])
    new.polygon.points = points
    return new


TYPES = {
    "rosgraph_msgs/Clock": (rosgraph1.Clock, rosgraph2.Clock, _clock),
    "sensor_msgs/LaserScan": (sensor1.LaserScan, sensor2.LaserScan, _scan),
    "sensor_msgs/Image": (sensor1.Image, sensor2.Image, _image),
    "sensor_msgs/JointState": (sensor1.JointState, sensor2.JointState, _joints),
    "nav_msgs/Odometry": (nav1.Odometry, nav2.Odometry, _odometry),
    "nav_msgs/Path": (nav1.Path, nav2.Path, _path),
    "nav_msgs/OccupancyGrid": (nav1.OccupancyGrid, nav2.OccupancyGrid, _grid),
    "geometry_msgs/PoseStamped": (geometry1.PoseStamped, geometry2.PoseStamped, _stamped_pose),
    "geometry_msgs/PoseArray": (geometry1.PoseArray, geometry2.PoseArray, _particles),
    "geometry_msgs/PolygonStamped": (
        geometry1.PolygonStamped,
        geometry2.PolygonStamped,
        _polygon,
    ),
    "geometry_msgs/PoseWithCovarianceStamped": (
        geometry1.PoseWithCovarianceStamped,
        geometry2.PoseWithCovarianceStamped,
        _estimate,
    ),
}
"""Message classes of ROS 1 and ROS 2, and the function from one to the other."""


def carry(node: Any, source: Any, target: Any, type_name: Any, qos: Any, own_frames: Any) -> None:
    """Subscribes to a topic of ROS 1 and publishes its messages in ROS 2."""
    old, new, convert = TYPES[type_name]
    publisher = node.create_publisher(new, target, PROFILES[qos])
    prefix = f"{source.split('/')[1]}/"

    def receive(message: Any) -> None:
        converted = convert(message)
        if own_frames:
            converted.header.frame_id = converted.header.frame_id.removeprefix(prefix)
        publisher.publish(converted)

    rospy.Subscriber(source, old, receive, queue_size=10, buff_size=2**22, tcp_nodelay=True)


def least_time(path: Any) -> Any:
    """Returns the least CPU time of one conversion of a message from bytes to bytes [s]."""
    with open(path, "rb") as file:
        type_name = file.readline().decode().strip()
        data = file.read()
    old, _, convert = TYPES[type_name]
    times = []
    for _ in range(REPETITIONS):
        began = time.process_time()
        count = 0
        while time.process_time() < began + LONG_ENOUGH:
            message = old()
            message.deserialize(data)
            serialize_message(convert(message))
            count += 1
        times.append((time.process_time() - began) / count)
    return min(times)


def main() -> None:
    """Entry point."""
    if sys.argv[1] == "convert":
        print(json.dumps(least_time(sys.argv[2])))
        return
    rospy.init_node("bridge", disable_signals=True, disable_rosout=True)
    rclpy.init()
    node = rclpy.create_node("bridge")
    for row in json.loads(sys.argv[1]):
        carry(node, *row)
    try:
        rclpy.spin(node)
    finally:
        # rospy's threads would keep the process.
        os._exit(0)


if __name__ == "__main__":
    main()
