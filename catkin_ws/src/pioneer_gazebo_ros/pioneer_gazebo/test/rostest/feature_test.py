#!/usr/bin/env python3
"""What a user of rosaria expects of a simulated robot, and how robots encounter walking people."""

import re
import sys
import threading
import unittest
from collections.abc import Callable
from typing import Any

import rospy
import rostest
from gazebo_msgs import srv
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry
from pioneer_msgs.msg import BumperState
from sensor_msgs.msg import (
    BatteryState,
    CameraInfo,
    Image,
    Imu,
    JointState,
    LaserScan,
    NavSatFix,
    PointCloud,
    PointCloud2,
    Range,
)
from std_msgs.msg import Bool, Float32, Float64, Int8, UInt32
from tf2_msgs.msg import TFMessage

PATIENCE = 60.0
START = Pose(Point(-3.5, 0.0, 0.0), Quaternion(0.0, 0.0, -0.7071, 0.7071))
"""In the path of person_1, facing away."""


def first(topic: str, kind: Any, wanted: Callable[[Any], bool] = lambda message: True) -> Any:
    """Returns the first message for which ``wanted`` holds."""
    found: list[Any] = []
    came = threading.Event()

    def store(message: Any) -> None:
        if not found and wanted(message):
            found.append(message)
            came.set()

    subscriber = rospy.Subscriber(topic, kind, store)
    assert came.wait(PATIENCE), f"{topic}: what is wanted did not come"
    subscriber.unregister()
    return found[0]


SLIDER = """<robot name="slider"><link name="base"><inertial><mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/>
</inertial><collision><geometry><box size="0.3 0.3 0.2"/></geometry></collision></link>
<gazebo><plugin name="move" filename="libgazebo_ros_planar_move.so"><robotBaseFrame>base</robotBaseFrame>
<robotNamespace>/slider</robotNamespace></plugin><plugin name="imu" filename="libgazebo_ros_imu.so">
<bodyName>base</bodyName><topicName>imu/data</topicName><updateRate>50</updateRate></plugin>
<plugin name="gps" filename="libhector_gazebo_ros_gps.so"><bodyName>base</bodyName></plugin></gazebo>
<gazebo reference="base"><sensor type="depth" name="kinect"><update_rate>10</update_rate><camera>
<horizontal_fov>1.2</horizontal_fov><image><width>80</width><height>60</height></image>
<clip><near>0.05</near><far>9</far></clip></camera>
<plugin name="kinect" filename="libgazebo_ros_openni_kinect.so"><cameraName>kinect</cameraName></plugin></sensor>
</gazebo>
</robot>"""


PARTS = """<robot name="parts"><link name="base"><inertial><mass value="20"/><inertia ixx="1" iyy="1" izz="1"/>
</inertial><collision><geometry><box size="0.3 0.3 0.2"/></geometry></collision></link>
<link name="fork"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial></link>
<joint name="lift" type="prismatic"><origin xyz="0 0 0.3"/><parent link="base"/><child link="fork"/>
<axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="200" velocity="0.5"/></joint>
<gazebo><plugin name="move" filename="libgazebo_ros_planar_move.so"><robotBaseFrame>base</robotBaseFrame>
<robotNamespace>/undercarriage</robotNamespace></plugin><plugin name="c" filename="libgazebo_ros_control.so">
<robotNamespace>/mast</robotNamespace></plugin></gazebo><gazebo reference="base"><sensor type="ray" name="scan"><ray>
<scan><horizontal><samples>9</samples><min_angle>-1</min_angle><max_angle>1</max_angle></horizontal></scan>
<range><min>0.2</min><max>30</max></range></ray><plugin name="laser" filename="libgazebo_ros_laser.so">
<topicName>scan</topicName><frameName>base</frameName><robotNamespace>/sensors</robotNamespace></plugin></sensor>
</gazebo></robot>"""


class FeatureTest(unittest.TestCase):
    """pioneer1 and pioneer2, each spawned once for all tests."""

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node("feature_test", disable_rostime=True)
        rospy.wait_for_message("/gazebo/ready", Bool, PATIENCE)
        rospy.wait_for_service("/gazebo/spawn_urdf_model", PATIENCE)
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", srv.SpawnModel)
        description = rospy.get_param("/robot_description")
        answer = spawn(
            "pioneer1", description, "pioneer1", Pose(Point(0, -3.5, 0), Quaternion(0, 0, 0, 1)), ""
        )
        assert answer.success, answer.status_message
        answer = spawn("pioneer2", description, "pioneer2", START, "")
        assert answer.success, answer.status_message

    def test_the_battery_is_reported_under_rosarias_names_and_falls(self) -> None:
        state = first("/pioneer1/battery_state", BatteryState)
        assert 0.99 < state.percentage <= 1.0
        assert 11.4 < state.voltage < 12.9
        assert state.current < 0
        assert state.header.frame_id == "pioneer1/base_link"
        later = first(
            "/pioneer1/battery_state",
            BatteryState,
            lambda message: message.percentage < state.percentage,
        )
        assert later.header.stamp > state.header.stamp
        assert 11.4 < first("/pioneer1/battery_voltage", Float64).data < 12.9
        assert first("/pioneer1/battery_state_of_charge", Float32).data <= state.percentage
        assert first("/pioneer1/battery_recharge_state", Int8).data == 0
        assert first("/pioneer1/motors_state", Bool).data

    def test_a_robot_of_others_slides_and_reports_inertia_place_and_depth(self) -> None:
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", srv.SpawnModel)
        answer = spawn(
            "slider", SLIDER, "", Pose(Point(2.0, -3.5, 0.1), Quaternion(0, 0, 0, 1)), ""
        )
        assert answer.success, answer.status_message
        command = rospy.Publisher("/slider/cmd_vel", Twist, queue_size=1, latch=True)
        command.publish(Twist(Vector3(0.0, 0.2, 0.0), Vector3()))
        first("/slider/odom", Odometry, lambda message: message.pose.pose.position.y > -3.3)
        command.publish(Twist())

        def stands(message: Imu) -> bool:
            felt = message.linear_acceleration
            return abs(felt.x) < 0.1 and abs(felt.z - 9.8) < 0.5

        first("/slider/imu/data", Imu, stands)
        assert abs(first("/slider/fix", NavSatFix).latitude - 49.9) < 0.001
        cloud = first("/slider/kinect/points", PointCloud2)
        assert (cloud.width, cloud.height, len(cloud.data)) == (80, 60, 80 * 60 * 12)
        assert first("/slider/kinect/depth/image_raw", Image).encoding == "32FC1"
        assert first("/slider/kinect/depth/camera_info", CameraInfo).width == 80

    def test_a_robot_under_ros_control_drives_by_the_yaml_in_its_namespace(self) -> None:
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", srv.SpawnModel)
        wheels = {f"{side}_wheel": f"base_{side}_wheel_joint" for side in ("left", "right")}
        base = {"type": "diff_drive_controller/DiffDriveController", "base_frame_id": "base_link", **wheels,
                "wheel_radius": 0.0975, "wheel_separation": 0.33}  # fmt: skip
        rospy.set_param("/controlled/base", base)
        rospy.set_param(
            "/controlled/states", {"type": "joint_state_controller/JointStateController"}
        )
        drive = r'<plugin [^>]*libgazebo_ros_diff_drive.so"[^>]*>.*?</plugin>'
        control = '<plugin name="control" filename="libgazebo_ros_control.so"/>'
        text, count = re.subn(
            drive, control, rospy.get_param("/robot_description"), flags=re.DOTALL
        )
        assert count == 1
        answer = spawn(
            "controlled", text, "controlled", Pose(Point(-0.5, -1.5, 0), Quaternion(0, 0, 0, 1)), ""
        )
        assert answer.success, answer.status_message
        command = rospy.Publisher("/controlled/base/cmd_vel", Twist, queue_size=1, latch=True)
        odometry = first("/controlled/base/odom", Odometry)
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        command.publish(Twist(Vector3(0.4, 0.0, 0.0), Vector3()))
        first("/controlled/base/odom", Odometry, lambda message: message.twist.twist.linear.x > 0.3)
        first(
            "/controlled/base/odom", Odometry, lambda message: message.twist.twist.linear.x < 0.01
        )
        turned = first("/controlled/joint_states", JointState)
        assert max(turned.position) > 1.0

    def test_each_plugin_of_a_robot_is_in_its_own_namespace_and_a_lift_obeys(self) -> None:
        states = {"type": "joint_state_controller/JointStateController", "publish_rate": 50}
        lift = {"type": "position_controllers/JointPositionController", "joint": "lift"}
        rospy.set_param("/mast", {"states": states, "lift": lift})
        rospy.set_param("/sensors/tf_prefix", "eyes")
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", srv.SpawnModel)
        at = Pose(Point(-3.5, -3.5, 0.1), Quaternion(0, 0, 0, 1))
        answer = spawn("parts", PARTS, "parts", at, "")
        assert answer.success, answer.status_message
        assert first("/sensors/scan", LaserScan).header.frame_id == "eyes/base"
        assert first("/undercarriage/odom", Odometry).header.frame_id == "odom"
        first("/parts/collisions", UInt32)
        command = rospy.Publisher("/mast/lift/command", Float64, queue_size=1, latch=True)
        command.publish(0.3)
        first(
            "/mast/joint_states", JointState, lambda message: abs(message.position[0] - 0.3) < 2e-3
        )

    def test_the_camera_shows_the_world_while_somebody_looks(self) -> None:
        image = first("/pioneer1/camera/image_raw", Image)
        info = first("/pioneer1/camera/camera_info", CameraInfo)
        assert (image.width, image.height, image.encoding, image.step) == (320, 240, "rgb8", 960)
        assert len(image.data) == 240 * 960
        assert image.header.frame_id == info.header.frame_id == "pioneer1/camera_optical_frame"
        assert (info.width, info.height, info.P[2]) == (320, 240, 159.5)
        assert len(set(image.data[::97])) > 10, "one colour only"

    def test_the_sonar_ring_is_one_cloud_of_sixteen_points(self) -> None:
        cloud = first("/pioneer1/sonar", PointCloud)
        assert cloud.header.frame_id == "pioneer1/base_link"
        assert len(cloud.points) == 16
        right = min(cloud.points, key=lambda point: point.y)
        assert abs(right.y + 0.5) < 0.1, "the southern wall is half a metre to the right"

    def test_a_sonar_is_a_range_with_its_own_frame(self) -> None:
        reading = first("/pioneer1/sonar/sonar_7", Range)
        assert reading.header.frame_id == "pioneer1/sonar_7"
        assert reading.radiation_type == Range.ULTRASOUND
        assert reading.min_range <= reading.range <= reading.max_range

    def test_odometry_of_the_world_is_where_the_robot_is(self) -> None:
        description = rospy.get_param("/robot_description").replace(">encoder<", ">world<")
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", srv.SpawnModel)
        answer = spawn(
            "pioneer3",
            description,
            "pioneer3",
            Pose(Point(-2.0, -1.5, 0), Quaternion(0, 0, 0, 1)),
            "",
        )
        assert answer.success, answer.status_message
        pose = first("/pioneer3/odom", Odometry).pose.pose.position
        assert abs(pose.x + 2.0) < 0.01
        assert abs(pose.y + 1.5) < 0.01

    def test_a_drive_publishes_its_wheels_transforms_and_joints_where_asked_to(self) -> None:
        asked = "<publishWheelTF>true</publishWheelTF><publishWheelJointState>true</publishWheelJointState>"
        description = rospy.get_param("/robot_description").replace(
            "<odometrySource>", f"{asked}<odometrySource>"
        )
        assert asked in description
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", srv.SpawnModel)
        answer = spawn(
            "wheels", description, "wheels", Pose(Point(3.5, 0.0, 0), Quaternion(0, 0, 0, 1)), ""
        )
        assert answer.success, answer.status_message
        both = ["base_left_wheel_joint", "base_right_wheel_joint"]
        first("/wheels/joint_states", JointState, lambda message: message.name == both)
        found: set[str] = set()

        def complete(message: TFMessage) -> bool:
            found.update(one.child_frame_id for one in message.transforms)
            return {"left_wheel", "right_wheel"} <= found

        first("/tf", TFMessage, complete)

    def test_physics_are_set_and_senseless_ones_refused(self) -> None:
        ask = rospy.ServiceProxy("/gazebo/get_physics_properties", srv.GetPhysicsProperties)
        tell = rospy.ServiceProxy("/gazebo/set_physics_properties", srv.SetPhysicsProperties)
        before = ask()
        assert tell(0.01, 100.0, Vector3(0.0, 0.0, -3.7), before.ode_config).success
        changed = ask()
        assert abs(changed.time_step - 0.01) < 1e-9
        assert (changed.gravity.z, changed.max_update_rate) == (-3.7, 100.0)
        # Gazebo's default step is shorter than a tick: the nearest possible one, at the same real-time factor.
        near = tell(0.001, 1000.0, Vector3(0.0, 0.0, -3.7), before.ode_config)
        assert near.success
        assert "0.00166667 s in place of 0.001 s" in near.status_message
        changed = ask()
        assert abs(changed.time_step - 1 / 600) < 1e-9
        assert abs(changed.max_update_rate - 600.0) < 1e-6
        for step, rate, gravity in (
            (0.0, 50.0, Vector3()),
            (float("nan"), 50.0, Vector3()),
            (0.02, -1.0, Vector3()),
            (0.02, 50.0, Vector3(0.0, 0.0, float("inf"))),
            (1.5, 50.0, Vector3()),
        ):
            refused = tell(step, rate, gravity, before.ode_config)
            assert not refused.success
            assert "\n" not in refused.status_message
        assert tell(
            before.time_step, before.max_update_rate, before.gravity, before.ode_config
        ).success
        assert ask().time_step == before.time_step

    def test_a_bumper_tells_where_a_robot_drives_into_a_wall(self) -> None:
        state = first("/pioneer1/bumper_state", BumperState)
        assert (len(state.front_bumpers), len(state.rear_bumpers)) == (5, 5)
        assert not any([*state.front_bumpers, *state.rear_bumpers])
        command = rospy.Publisher("/pioneer1/pioneer/cmd_vel", Twist, queue_size=1, latch=True)
        driving = Twist()
        driving.linear.x = 0.8
        command.publish(driving)
        hit = first(
            "/pioneer1/bumper_state", BumperState, lambda message: any(message.front_bumpers)
        )
        assert not any(hit.rear_bumpers)
        idle = first("/pioneer2/battery_state", BatteryState)
        held = first(
            "/pioneer1/battery_state",
            BatteryState,
            lambda message: message.current < 2 * idle.current,
        )
        assert held.voltage < idle.voltage
        command.publish(Twist())

    def test_a_person_walks_into_a_robot_that_stands_in_the_way(self) -> None:
        first("/pioneer2/collisions", UInt32, lambda message: message.data > 0)


if __name__ == "__main__":
    rostest.rosrun("pioneer_gazebo", "feature", FeatureTest, sys.argv)
