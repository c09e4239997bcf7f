#!/usr/bin/env python3
"""amcl follows a synthetic robot through a room: poses, tf, services, jumps of time."""

import math
import sys
import threading
import unittest
from collections.abc import Callable

import numpy as np
import pytest
import rospy
import rostest
from dynamic_reconfigure import DynamicReconfigureCallbackException
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.srv import SetMap, SetMapRequest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

from nav_bundle import _likelihood
from nav_bundle.conversions import (
    GridMessage,
    message_from_grid,
    message_from_pose,
    pose_from_message,
    yaw_from_quaternion,
)
from nav_bundle.core.grid import Grid, grid_from_text
from nav_bundle.core.pose import Pose
from nav_bundle.core.sensor import placement
from nav_bundle.nodes.transform import TransformBroadcaster

ROOM = ["#########", "#.......#", "#..#....#", "#.......#", "#.....###", "#.......#", "#########"]
START = Pose(1.5, 1.5, 0.0)
ODOM_START = Pose(-4.0, 3.0, 1.0)


def room() -> Grid:
    drawn = grid_from_text(ROOM)
    return Grid(0.05, Pose(), np.ascontiguousarray(np.kron(drawn.cells, np.ones((16, 16), np.int8))))


class FakeRobot:
    """Publishes clock, odometry and scans of a robot in the room; time passes by ``tick`` alone."""

    def __init__(self) -> None:
        self.grid = room()
        self.pose, self.odom, self.time = START, ODOM_START, 100.0
        self._clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self._scan = rospy.Publisher("/pioneer3/base_scan", LaserScan, queue_size=10)
        self._map = rospy.Publisher("/map", GridMessage, queue_size=1, latch=True)
        self._map.publish(message_from_grid(self.grid, "/map", rospy.Time(1)))
        self._tf = TransformBroadcaster()

    def tick(self, length: float = 0.0, turn: float = 0.0) -> None:
        """Lets 0.1 s pass, in which the robot drives; its odometry overrates distances by 2 %."""
        self.time += 0.1
        self.pose = self.pose.compose(Pose(length, 0.0, turn))
        self.odom = self.odom.compose(Pose(1.02 * length, 0.0, turn))
        stamp = rospy.Time.from_sec(self.time)
        self._clock.publish(Clock(stamp))
        # The scan goes out first: amcl has to wait for the odometry of its stamp.
        self._scan.publish(self._measured(stamp))
        self._tf.send("pioneer3/base_link", "pioneer3/laser", stamp, Pose(0.1, 0.0, 0.0))
        self._tf.send("pioneer3/odom", "pioneer3/base_link", stamp, self.odom)

    def _measured(self, stamp: rospy.Time) -> LaserScan:
        scan = LaserScan(angle_min=-math.pi, angle_max=math.pi, angle_increment=math.tau / 179, range_max=30.0)
        scan.header.stamp, scan.header.frame_id = stamp, "pioneer3/laser"
        ranges = np.empty((1, 180))
        poses = np.array([[self.pose.x, self.pose.y, self.pose.yaw]])
        bearings = scan.angle_min + scan.angle_increment * np.arange(180)
        laser = np.array([0.1, 0.0, 0.0])
        _likelihood.expected_ranges(poses, laser, bearings, self.grid.cells, placement(self.grid), 30.0, ranges)
        scan.ranges = ranges[0].tolist()
        return scan


class AmclCheck(unittest.TestCase):
    robot: FakeRobot

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = FakeRobot()

    def setUp(self) -> None:
        self.arrived = threading.Condition()
        self.map_from_odom: Pose | None = None
        self.stamp = 0.0
        self.estimate: PoseWithCovarianceStamped | None = None
        self.cloud: PoseArray | None = None
        self.subscribers = [
            rospy.Subscriber("/tf", TFMessage, self.on_tf, queue_size=100),
            rospy.Subscriber("/pioneer3/amcl_pose", PoseWithCovarianceStamped, self.store("estimate")),
            rospy.Subscriber("/pioneer3/particlecloud", PoseArray, self.store("cloud")),
        ]

    def tearDown(self) -> None:
        for subscriber in self.subscribers:
            subscriber.unregister()

    def store(self, name: str) -> Callable[[object], None]:
        def keep(message: object) -> None:
            with self.arrived:
                setattr(self, name, message)
                self.arrived.notify_all()

        return keep

    def on_tf(self, message: TFMessage) -> None:
        for edge in message.transforms:
            if (edge.header.frame_id, edge.child_frame_id) == ("map", "pioneer3/odom"):
                with self.arrived:
                    place, turn = edge.transform.translation, edge.transform.rotation
                    self.map_from_odom = Pose(place.x, place.y, yaw_from_quaternion(turn))
                    self.stamp = edge.header.stamp.to_sec()
                    self.arrived.notify_all()

    def drive_until(self, condition: Callable[[], bool], what: str, length: float = 0.0, turn: float = 0.0) -> None:
        """Ticks, each time as soon as amcl has answered the last, until the condition holds."""
        for _ in range(300):
            self.robot.tick(length, turn)
            with self.arrived:
                if self.arrived.wait_for(condition, timeout=0.1):
                    return
        self.fail(f"{what} did not come; last tf {self.map_from_odom} at {self.stamp}")

    def error(self) -> float:
        assert self.map_from_odom is not None
        return self.map_from_odom.compose(self.robot.odom).distance(self.robot.pose)

    def answered(self) -> bool:
        """Tells whether amcl has sent tf for the robot's last scan."""
        return abs(self.stamp - self.robot.time - 0.5) < 1e-6

    def is_localised(self) -> bool:
        """Tells whether that tf is right to 5 cm."""
        return self.answered() and self.error() < 0.05

    def is_spread(self) -> bool:
        """Tells whether the particles fill the room and look everywhere."""
        poses = [pose_from_message(pose) for pose in self.cloud.poses] if self.cloud else [Pose()]
        return np.ptp([pose.x for pose in poses]) > 3.0 and np.ptp([pose.yaw for pose in poses]) > 4.0

    def test_1_a_driving_robot_is_followed(self) -> None:
        self.drive_until(self.answered, "tf map to odom of the last scan, stamped ahead by transform_tolerance")
        errors = []
        for turn in [0.0] * 60 + [math.pi / 20] * 10 + [0.0] * 30:
            self.drive_until(self.answered, "tf of the last scan", 0.0 if turn else 0.05, turn)
            errors.append(self.error())
        assert np.mean(errors) < 0.03, errors
        assert self.estimate is not None
        assert self.estimate.header.frame_id == "map"
        assert 0.0 < self.estimate.pose.covariance[0] < 0.1
        assert self.cloud is not None
        assert 500 <= len(self.cloud.poses) <= 2000
        saved = rospy.get_param("/pioneer3/amcl/initial_pose_x")
        assert abs(saved - self.robot.pose.x) < 1.0
        assert saved != 1.4

    def test_2_a_robot_at_rest_is_updated_on_request(self) -> None:
        self.drive_until(self.answered, "tf of the last scan")
        before = rospy.wait_for_message("/pioneer3/amcl_pose", PoseWithCovarianceStamped, timeout=5).header.stamp
        rospy.ServiceProxy("/pioneer3/request_nomotion_update", Empty)()
        self.drive_until(lambda: self.estimate is not None and self.estimate.header.stamp > before, "a forced update")

    def test_3_an_initial_pose_is_taken(self) -> None:
        self.robot.pose = Pose(5.0, 1.4, 0.3)
        message = PoseWithCovarianceStamped()
        message.header.frame_id = "/map"
        message.pose.pose = message_from_pose(self.robot.pose.compose(Pose(0.2, 0.1, 0.1)))
        message.pose.covariance[0] = message.pose.covariance[7] = message.pose.covariance[35] = 0.05
        publisher = rospy.Publisher("/pioneer3/initialpose", PoseWithCovarianceStamped, queue_size=1, latch=True)
        publisher.publish(message)
        self.drive_until(self.is_localised, "localisation at the initial pose")
        publisher.unregister()

    def test_4_a_map_is_set_by_service(self) -> None:
        self.robot.pose = START
        request = SetMapRequest(map=message_from_grid(room(), "map", rospy.Time(1)))
        request.map.data = request.map.data.tolist()
        request.initial_pose.header.frame_id = "map"
        request.initial_pose.pose.pose = message_from_pose(START)
        request.initial_pose.pose.covariance[0] = request.initial_pose.pose.covariance[7] = 0.05
        assert rospy.ServiceProxy("/pioneer3/set_map", SetMap)(request).success
        self.drive_until(self.is_localised, "localisation in the map that was set")

    def test_5_a_lost_robot_spreads_its_particles(self) -> None:
        rospy.ServiceProxy("/pioneer3/global_localization", Empty)()
        self.drive_until(self.is_spread, "particles all over the room, in all headings")

    def test_6_time_that_jumps_back_starts_anew(self) -> None:
        self.drive_until(self.answered, "tf of the last scan")
        self.robot.pose, self.robot.time = START, 3.0
        self.drive_until(self.is_localised, "localisation after time jumped back")

    def test_7_parameters_change_under_way(self) -> None:
        client = Client("/pioneer3/amcl", timeout=10)
        held = client.update_configuration({"min_particles": 700, "laser_z_hit": 0.6, "max_particles": 99999})
        assert (held["min_particles"], held["laser_z_hit"], held["max_particles"]) == (700, 0.6, 10000)
        self.drive_until(lambda: self.answered() and len(self.cloud.poses) >= 700, "a larger cloud", 0.02)
        held = client.update_configuration({"laser_model_type": "likelihood_field_prob", "odom_model_type": "omni"})
        assert held["laser_model_type"] == "likelihood_field_prob"
        self.drive_until(self.is_localised, "localisation by the other laser model", 0.0, 0.05)
        with pytest.raises(DynamicReconfigureCallbackException):
            client.update_configuration({"min_particles": 800, "max_particles": 750})
        held = client.update_configuration({"restore_defaults": True})
        assert (held["min_particles"], held["max_particles"], held["laser_model_type"]) == (
            500,
            2000,
            "likelihood_field",
        )


if __name__ == "__main__":
    rospy.init_node("amcl_check")
    rostest.rosrun("nav_bundle", "amcl_check", AmclCheck, sys.argv)
