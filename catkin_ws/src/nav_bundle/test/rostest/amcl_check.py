#!/usr/bin/env python3
"""amcl tracks a synthetic robot in a room: poses, tf, services, clock jumps."""

import math
import sys

import numpy as np
import pytest
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure import DynamicReconfigureCallbackException
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.srv import SetMap, SetMapRequest
from room_robot import START, RoomRobot, RoomTest
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

from nav_bundle.base.conversions import message_from_pose, pose_from_message
from nav_bundle.base.pose import Pose
from nav_bundle.maps.conversions import GridMessage, message_from_grid
from pioneer_harness.wait import wait_until


class AmclCheck(RoomTest):
    diagnosis: DiagnosticArray | None
    estimate: PoseWithCovarianceStamped | None
    cloud: PoseArray | None

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = RoomRobot(0.02)
        cls.map = rospy.Publisher("/map", GridMessage, queue_size=1, latch=True)
        cls.map.publish(message_from_grid(cls.robot.grid, "/map", rospy.Time(1)))
        cls.initial_pose = rospy.Publisher(
            "/pioneer3/initialpose", PoseWithCovarianceStamped, queue_size=1
        )

    def setUp(self) -> None:
        super().setUp()
        self.listen("/diagnostics", DiagnosticArray, "diagnosis")
        self.listen("/pioneer3/amcl_pose", PoseWithCovarianceStamped, "estimate")
        self.listen("/pioneer3/particlecloud", PoseArray, "cloud")
        self.robot.pose = START
        self.say_pose(START)
        self.drive_until(self.is_localised, "localisation at the start")

    def say_pose(self, pose: Pose) -> None:
        message = PoseWithCovarianceStamped()
        message.header.frame_id = "/map"
        message.pose.pose = message_from_pose(pose)
        message.pose.covariance[0] = message.pose.covariance[7] = message.pose.covariance[35] = 0.05
        wait_until(self.initial_pose.get_num_connections, "a subscriber of initialpose", 30.0)
        self.initial_pose.publish(message)

    def error(self) -> float:
        assert self.map_from_odom is not None
        return self.map_from_odom.compose(self.robot.odom).distance(self.robot.pose)

    def answered(self) -> bool:
        """Returns whether amcl has published tf for the robot's latest scan."""
        return abs(self.stamp - self.robot.time - 0.5) < 1e-6

    def is_localised(self) -> bool:
        """Returns whether amcl has answered and its pose is within 5 cm of the truth."""
        return self.answered() and self.error() < 0.05

    def particles(self) -> int:
        return len(self.cloud.poses) if self.cloud else 0

    def is_spread(self) -> bool:
        """Returns whether the particles are spread over the room and over all headings."""
        poses = [pose_from_message(pose) for pose in self.cloud.poses] if self.cloud else [Pose()]
        return (
            np.ptp([pose.x for pose in poses]) > 3.0 and np.ptp([pose.yaw for pose in poses]) > 4.0
        )

    def test_a_driving_robot_is_followed(self) -> None:
        self.drive_until(
            self.answered, "tf map to odom of the last scan, stamped ahead by transform_tolerance"
        )
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
        assert self.diagnosis is not None
        [status] = self.diagnosis.status
        assert status.name == "pioneer3/amcl: Standard deviation"
        assert {value.key for value in status.values} >= {
            "std_x",
            "std_y",
            "std_yaw",
            "std_warn_level_yaw",
        }
        saved = rospy.get_param("/pioneer3/amcl/initial_pose_x")
        assert abs(saved - self.robot.pose.x) < 1.0
        assert saved != 1.4

    def test_a_robot_at_rest_is_updated_on_request(self) -> None:
        self.drive_until(self.answered, "tf of the last scan")
        before = rospy.wait_for_message(
            "/pioneer3/amcl_pose", PoseWithCovarianceStamped, timeout=5
        ).header.stamp
        rospy.ServiceProxy("/pioneer3/request_nomotion_update", Empty)()
        self.drive_until(
            lambda: self.estimate is not None and self.estimate.header.stamp > before,
            "a forced update",
        )

    def test_an_initial_pose_is_taken(self) -> None:
        self.robot.pose = Pose(5.0, 1.4, 0.3)
        self.say_pose(self.robot.pose.compose(Pose(0.2, 0.1, 0.1)))
        self.drive_until(self.is_localised, "localisation at the initial pose")

    def test_a_map_is_set_by_service(self) -> None:
        self.robot.pose = START
        request = SetMapRequest(map=message_from_grid(self.robot.grid, "map", rospy.Time(1)))
        request.map.data = request.map.data.tolist()
        request.initial_pose.header.frame_id = "map"
        request.initial_pose.pose.pose = message_from_pose(START)
        request.initial_pose.pose.covariance[0] = request.initial_pose.pose.covariance[7] = 0.05
        assert rospy.ServiceProxy("/pioneer3/set_map", SetMap)(request).success
        self.drive_until(self.is_localised, "localisation in the map that was set")

    def test_a_lost_robot_spreads_its_particles(self) -> None:
        rospy.ServiceProxy("/pioneer3/global_localization", Empty)()
        self.drive_until(self.is_spread, "particles all over the room, in all headings")

    def test_time_that_jumps_back_restarts_it(self) -> None:
        self.drive_until(self.answered, "tf of the last scan")
        self.robot.pose, self.robot.time = START, 3.0
        self.drive_until(self.is_localised, "localisation after time jumped back")

    def test_a_clock_that_is_set_back_a_little_changes_nothing(self) -> None:
        self.robot.pose = Pose(5.0, 1.4, 0.3)
        self.say_pose(self.robot.pose)
        self.drive_until(self.is_localised, "localisation at the initial pose")
        self.robot.time -= 0.6
        self.drive_until(self.answered, "tf of a scan after the step")
        assert self.is_localised()

    def test_parameters_change_under_way(self) -> None:
        client = Client("/pioneer3/amcl", timeout=10)
        self.addCleanup(client.update_configuration, {"restore_defaults": True})
        held = client.update_configuration(
            {"min_particles": 700, "laser_z_hit": 0.6, "max_particles": 99999}
        )
        assert (held["min_particles"], held["laser_z_hit"], held["max_particles"]) == (
            700,
            0.6,
            10000,
        )
        self.drive_until(
            lambda: self.answered() and self.particles() >= 700, "a larger cloud", 0.02
        )
        held = client.update_configuration(
            {"laser_model_type": "likelihood_field_prob", "odom_model_type": "omni"}
        )
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

    def test_messages_that_cannot_be_used_cost_only_themselves(self) -> None:
        nowhere, future = TransformStamped(), TransformStamped()
        nowhere.transform.rotation.w = future.transform.rotation.w = 1.0
        future.header.frame_id, future.child_frame_id = "pioneer3/odom", "pioneer3/base_link"
        future.header.stamp = rospy.Time(2_000_000_000)
        pose, grid = (
            PoseWithCovarianceStamped(),
            message_from_grid(self.robot.grid, "/map", rospy.Time(1)),
        )
        pose.pose.pose.position.x = math.nan
        grid.info.origin.position.y = math.nan
        bad = {
            "/pioneer3/base_scan": LaserScan(ranges=[1.0]),
            "/tf": TFMessage([nowhere, future]),
            "/pioneer3/initialpose": pose,
            "/map": grid,
        }
        for topic, message in bad.items():
            publisher = rospy.Publisher(topic, type(message), queue_size=1, latch=True)
            publisher.publish(message)
            wait_until(publisher.get_num_connections, f"a subscriber of {topic}", 10.0)
        self.drive_until(
            self.is_localised, "localisation after messages that cannot be used", 0.05, 0.05
        )


if __name__ == "__main__":
    rospy.init_node("amcl_check")
    rostest.rosrun("nav_bundle", "amcl_check", AmclCheck, sys.argv)
