#!/usr/bin/env python3
"""Bad input to the running simulator: each case gets a one-line error, and the existing robot keeps running."""

import math
import os
import sys
import tempfile
import threading
import unittest

import rospy
import rostest
from gazebo_msgs import srv
from gazebo_msgs.msg import ModelState
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3, Wrench
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

PATIENCE = 60.0

SDF = """<sdf version="1.6"><model name="m"><link name="l"><collision name="c"><geometry>{}</geometry></collision>
</link></model></sdf>"""


def pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(Point(x, y, z), Quaternion(0.0, 0.0, 0.0, 1.0))


class BadInputTest(unittest.TestCase):
    """One robot drives in circles throughout; after each test its odometry must keep arriving."""

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node("bad_input_test", disable_rostime=True)
        rospy.wait_for_message("/gazebo/ready", Bool, PATIENCE)
        for name, kind in (("urdf", srv.SpawnModel), ("sdf", srv.SpawnModel)):
            rospy.wait_for_service(f"/gazebo/spawn_{name}_model", PATIENCE)
            setattr(cls, name, rospy.ServiceProxy(f"/gazebo/spawn_{name}_model", kind))
        cls.delete = rospy.ServiceProxy("/gazebo/delete_model", srv.DeleteModel)
        cls.set_state = rospy.ServiceProxy("/gazebo/set_model_state", srv.SetModelState)
        cls.description = rospy.get_param("/robot_description")
        cls.stamp, cls.moved = 0.0, threading.Condition()
        answer = cls.urdf("good", cls.description, "good", pose(-1.0, -2.0), "")
        assert answer.success, answer.status_message
        rospy.Subscriber("/good/odom", Odometry, cls._note)
        cls.command = rospy.Publisher("/good/pioneer/cmd_vel", Twist, queue_size=1, latch=True)
        cls.command.publish(Twist(Vector3(0.2, 0.0, 0.0), Vector3(0.0, 0.0, 0.8)))

    @classmethod
    def _note(cls, message: Odometry) -> None:
        with cls.moved:
            cls.stamp, cls.speed = message.header.stamp.to_sec(), message.twist.twist.linear.x
            cls.moved.notify_all()

    def tearDown(self) -> None:
        with self.moved:
            now = self.stamp
            on = self.moved.wait_for(
                lambda: self.stamp > now + 0.5 and math.isfinite(self.speed), PATIENCE
            )
        assert on, "the simulator stands"

    def refused(self, answer: srv.SpawnModelResponse, word: str) -> None:
        assert not answer.success
        assert word in answer.status_message, answer.status_message
        assert "\n" not in answer.status_message
        assert len(answer.status_message) < 500

    def test_malformed_urdf(self) -> None:
        for text, word in [
            ("", "empty"),
            ("<robot", "line 1"),
            ("<robot name='r'/>", "link"),
            (
                "<robot name='r'><link name='a'/><link name='a'/></robot>",
                "named 'a' already exists",
            ),
            (self.description.replace('type="continuous"', 'type="bent"'), "joint type 'bent'"),
        ]:
            self.refused(self.urdf("r", text, "r", pose(2.0, -3.0), ""), word)

    def test_malformed_sdf(self) -> None:
        for text, word in [
            ("<sdf", "line 1"),
            ("<sdf version='1.6'/>", "neither"),
            (SDF.format("<box><size>1 nan 1</size></box>"), "size"),
            (SDF.format("<box><size>1 1</size></box>"), "size"),
            (SDF.format("<sphere><radius>-1</radius></sphere>"), "radius"),
        ]:
            self.refused(self.sdf("m", text, "m", pose(2.0, -3.0, 1.0), ""), word)

    def test_names(self) -> None:
        self.refused(
            self.urdf("good", self.description, "good", pose(2.0, -3.0), ""), "already exists"
        )
        self.refused(
            self.urdf("", self.description, "x", pose(2.0, -3.0), ""), "1 to 200 characters"
        )
        self.refused(
            self.urdf("n" * 10**6, self.description, "x", pose(2.0, -3.0), ""),
            "1 to 200 characters",
        )
        self.refused(
            self.urdf("x", self.description, "n" * 10**6, pose(2.0, -3.0), ""), "namespace"
        )
        self.refused(self.urdf("x", self.description, "no good", pose(2.0, -3.0), ""), "namespace")
        self.refused(self.delete("n" * 10**6), "does not exist")

    def test_poses(self) -> None:
        self.refused(self.urdf("x", self.description, "x", pose(-1.0, 3.0), ""), "overlap")
        self.refused(self.urdf("x", self.description, "x", pose(math.nan, 0.0), ""), "not finite")
        self.refused(self.urdf("x", self.description, "x", pose(0.0, math.inf), ""), "not finite")
        bad = ModelState("good", pose(math.nan, 0.0), Twist(), "")
        self.refused(self.set_state(bad), "not finite")

    def test_states_forces_and_shapes_beyond_all_bounds_are_refused(self) -> None:
        fast = Twist(Vector3(1e200, 0.0, 0.0), Vector3())
        self.refused(
            self.set_state(ModelState("good", pose(0.0, -2.0), fast, "")), "at most 1000 m/s"
        )
        self.refused(
            self.set_state(ModelState("good", pose(1e200, 0.0), Twist(), "")), "at most 1e+06 m"
        )
        rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1, latch=True).publish(
            ModelState("good", pose(0.0, -2.0), fast, "")
        )
        push = rospy.ServiceProxy("/gazebo/apply_body_wrench", srv.ApplyBodyWrench)
        wrench = Wrench(Vector3(1e200, 0.0, 0.0), Vector3())
        answer = push("good::base_link", "", Point(), wrench, rospy.Time(), rospy.Duration(1.0))
        self.refused(answer, "force must be finite")
        self.refused(
            self.sdf(
                "m", SDF.format("<sphere><radius>1e200</radius></sphere>"), "m", pose(2.0, -3.0), ""
            ),
            "size",
        )

    def test_meshes_that_are_no_regular_files_are_refused_at_once(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            os.mkfifo(f"{folder}/pipe.stl")
            os.symlink("/dev/zero", f"{folder}/zero.stl")
            for name, word in (
                ("pipe.stl", "regular"),
                ("zero.stl", "regular"),
                ("", "meshes are read from"),
            ):
                mesh = f"<mesh><uri>file://{folder}/{name}</uri></mesh>"
                self.refused(self.sdf("m", SDF.format(mesh), "m", pose(2.0, -3.0, 1.0), ""), word)

    def test_commands_that_are_not_finite_leave_the_one_before(self) -> None:
        for bad in (math.nan, math.inf, -math.inf):
            self.command.publish(Twist(Vector3(bad, 0.0, 0.0), Vector3()))
            self.command.publish(Twist(Vector3(0.2, 0.0, 0.0), Vector3(0.0, 0.0, bad)))
        with self.moved:
            now = self.stamp
            assert self.moved.wait_for(lambda: self.stamp > now + 1.0, PATIENCE)
            assert abs(self.speed - 0.2) < 0.05
        self.command.publish(Twist(Vector3(0.2, 0.0, 0.0), Vector3(0.0, 0.0, 0.8)))

    def test_a_robot_deleted_while_it_drives_and_commands_after_it_has_gone(self) -> None:
        answer = self.urdf("brief", self.description, "brief", pose(2.0, -3.0), "")
        assert answer.success, answer.status_message
        command = rospy.Publisher("/brief/pioneer/cmd_vel", Twist, queue_size=1, latch=True)
        command.publish(Twist(Vector3(0.5, 0.0, 0.0), Vector3()))
        rospy.wait_for_message("/brief/odom", Odometry, PATIENCE)
        assert self.delete("brief").success
        for _ in range(20):
            command.publish(Twist(Vector3(0.5, 0.0, 0.0), Vector3()))
        self.refused(self.delete("brief"), "does not exist")


if __name__ == "__main__":
    rostest.rosrun("pioneer_gazebo", "bad_input", BadInputTest, sys.argv)
