#!/usr/bin/env python3
"""Gazebo's complete ROS interface: what is offered, and what each service and setter does to a robot and a box."""

import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rospy
import rosservice
import rostest
from gazebo_msgs import srv
from gazebo_msgs.msg import LinkState, LinkStates, ModelState
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3, Wrench
from std_msgs.msg import Bool
from std_srvs.srv import Empty

PATIENCE = 60.0

SERVICES = {
    "spawn_urdf_model": "SpawnModel",
    "spawn_sdf_model": "SpawnModel",
    "delete_model": "DeleteModel",
    "get_model_state": "GetModelState",
    "set_model_state": "SetModelState",
    "get_model_properties": "GetModelProperties",
    "get_world_properties": "GetWorldProperties",
    "set_model_configuration": "SetModelConfiguration",
    "get_link_state": "GetLinkState",
    "set_link_state": "SetLinkState",
    "get_link_properties": "GetLinkProperties",
    "get_joint_properties": "GetJointProperties",
    "apply_body_wrench": "ApplyBodyWrench",
    "clear_body_wrenches": "BodyRequest",
    "apply_joint_effort": "ApplyJointEffort",
    "clear_joint_forces": "JointRequest",
    "clear_joint_efforts": "JointRequest",
    "get_physics_properties": "GetPhysicsProperties",
    "set_physics_properties": "SetPhysicsProperties",
}
STD_SERVICES = {
    "pause_physics": "Empty", "unpause_physics": "Empty", "reset_world": "Empty", "reset_simulation": "Empty",
    "step": "Trigger",
}  # fmt: skip

BOX = """<sdf version="1.6"><model name="box"><pose>0 0 0.25 0 0 0</pose><link name="body">
<inertial><mass>2</mass><inertia><ixx>0.08</ixx><iyy>0.08</iyy><izz>0.08</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz>
</inertia></inertial><collision name="cube"><geometry><box><size>0.5 0.5 0.5</size></box></geometry></collision>
</link></model></sdf>"""


def service(name: str, kind: Any) -> rospy.ServiceProxy:
    rospy.wait_for_service(f"/gazebo/{name}", PATIENCE)
    return rospy.ServiceProxy(f"/gazebo/{name}", kind)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(Point(x, y, z), Quaternion(0.0, 0.0, 0.0, 1.0))


def until(found: Callable[[], bool], what: str) -> None:
    """Polls the simulator until ``found`` holds, without a sleep: each service call takes its own time."""
    end = time.monotonic() + PATIENCE
    while not found():
        assert time.monotonic() < end, what


DOOR = """<sdf version="1.6"><model name="door"><link name="post"><pose>0 0 0.5 0 0 0</pose>
<inertial><mass>50</mass></inertial>
<collision name="c"><geometry><box><size>0.2 0.2 1.0</size></box></geometry></collision></link>
<link name="leaf"><pose>0.6 0 0.6 0 0 0</pose><inertial><mass>1</mass></inertial>
<collision name="c"><geometry><box><size>0.8 0.02 0.8</size></box></geometry></collision></link>
<joint name="hinge" type="revolute"><parent>post</parent><child>leaf</child><pose>-0.45 0 0 0 0 0</pose>
<axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint></model></sdf>"""


class InterfaceTest(unittest.TestCase):
    """A robot and a box, both spawned by spawn_model, which unpauses the simulation with the second one."""

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node("interface_test", disable_rostime=True)
        rospy.wait_for_message("/gazebo/ready", Bool, PATIENCE)
        cls.model = service("get_model_state", srv.GetModelState)
        cls.world = service("get_world_properties", srv.GetWorldProperties)
        cls.paused_at = cls.world().sim_time
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "box.sdf"
            file.write_text(BOX)
            words = [
                "-sdf",
                "-file",
                str(file),
                "-model",
                "box",
                "-x",
                "3",
                "-wait",
                "pioneer1",
                "-unpause",
            ]
            waiting = subprocess.Popen(["rosrun", "pioneer_gazebo", "spawn_model", *words])
            try:
                words = [
                    "-urdf",
                    "-param",
                    "/robot_description",
                    "-model",
                    "pioneer1",
                    "-robot_namespace",
                    "pioneer1",
                ]
                subprocess.run(
                    ["rosrun", "pioneer_gazebo", "spawn_model", *words],
                    check=True,
                    timeout=PATIENCE,
                )
                assert waiting.wait(PATIENCE) == 0
            finally:
                waiting.kill()
                waiting.wait()

    def place_of(self, name: str) -> Point:
        answer = self.model(name, "world")
        assert answer.success, answer.status_message
        return answer.pose.position

    def test_every_service_of_gazebo_ros_is_offered_with_its_type(self) -> None:
        wanted = {f"/gazebo/{name}": f"gazebo_msgs/{kind}" for name, kind in SERVICES.items()}
        wanted |= {f"/gazebo/{name}": f"std_srvs/{kind}" for name, kind in STD_SERVICES.items()}
        assert {name: rosservice.get_service_type(name) for name in wanted} == wanted

    def test_spawn_model_waited_for_the_other_and_let_time_go(self) -> None:
        assert self.paused_at == 0.0
        until(lambda: self.world().sim_time > 0.2, "time goes")
        names = self.world().model_names
        assert names.index("pioneer1") < names.index("box")

    def test_spawn_model_takes_the_other_arguments_of_gazebo_ros_script(self) -> None:
        """A model of the model path stays as long as the script runs; a door is spawned half open."""
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder) / "crate"
            model.mkdir()
            (model / "model.sdf").write_text(BOX)
            (Path(folder) / "door.sdf").write_text(DOOR)
            words = ["-sdf", "-package_to_model", "-b", "-database", "crate", "-model", "crate"]
            bonded = subprocess.Popen(
                ["rosrun", "pioneer_gazebo", "spawn_model", *words, "-x", "-3"],
                env={**os.environ, "GAZEBO_MODEL_PATH": folder},
            )
            try:
                until(lambda: "crate" in self.world().model_names, "the crate is there")
                words = ["-sdf", "-file", f"{folder}/door.sdf", "-model", "door", "-x", "-6"]
                words += ["-J", "hinge", "0.7"]
                spawn = ["rosrun", "pioneer_gazebo", "spawn_model", *words]
                subprocess.run(spawn, check=True, timeout=PATIENCE)
                assert bonded.poll() is None
            finally:
                bonded.send_signal(signal.SIGINT)
                bonded.wait(PATIENCE)
        until(lambda: "crate" not in self.world().model_names, "the crate is gone")
        properties = service("get_joint_properties", srv.GetJointProperties)
        [position] = properties("door::hinge").position
        assert abs(position - 0.7) < 0.05, position
        push = service("apply_joint_effort", srv.ApplyJointEffort)
        assert push("hinge", -2.0, rospy.Time(), rospy.Duration(-1)).success
        until(lambda: properties("door::hinge").position[0] < 0.3, "the door closes")
        service("clear_joint_forces", srv.JointRequest)("hinge")
        assert not push("no_such_joint", 1.0, rospy.Time(), rospy.Duration(1)).success
        assert service("delete_model", srv.DeleteModel)("door").success

    def test_models_links_and_joints_have_their_properties(self) -> None:
        properties = service("get_model_properties", srv.GetModelProperties)
        robot, ground = properties("pioneer1"), properties("ground_plane")
        assert (robot.success, robot.is_static, robot.canonical_body_name) == (
            True,
            False,
            "base_link",
        )
        assert {"laser", "left_wheel", "swivel"} <= set(robot.body_names)
        assert {"base_left_wheel_joint", "base_right_wheel_joint"} <= set(robot.joint_names)
        assert (ground.success, ground.is_static) == (True, True)
        box = service("get_link_properties", srv.GetLinkProperties)("box::body")
        assert (box.success, box.mass, box.izz) == (True, 2.0, 0.08)
        for answer in (
            properties("nobody"),
            service("get_link_properties", srv.GetLinkProperties)("box::lid"),
        ):
            assert not answer.success
            assert answer.status_message

    def test_a_wheels_joint_turns_with_the_robot_and_can_be_set(self) -> None:
        joint = service("get_joint_properties", srv.GetJointProperties)
        command = rospy.Publisher("/pioneer1/pioneer/cmd_vel", Twist, queue_size=1, latch=True)
        command.publish(Twist(Vector3(0.3, 0.0, 0.0), Vector3()))
        radius = 0.195 / 2
        until(
            lambda: abs(joint("base_left_wheel_joint").rate[0] * radius - 0.3) < 0.02,
            "the wheel turns",
        )
        assert joint("base_left_wheel_joint").type == srv.GetJointPropertiesResponse.CONTINUOUS
        command.publish(Twist())
        until(
            lambda: abs(joint("pioneer1::base_left_wheel_joint").rate[0]) < 0.01, "the wheel stands"
        )
        set_joint = service("set_model_configuration", srv.SetModelConfiguration)
        assert set_joint("pioneer1", "", ["base_left_wheel_joint"], [1.0]).success
        assert abs(joint("base_left_wheel_joint").position[0] - 1.0) < 0.01
        assert not set_joint("pioneer1", "", ["base_left_wheel_joint"], []).success
        assert not joint("no_such_joint").success

    def test_a_wrench_pushes_for_its_duration_and_an_endless_one_until_it_is_cleared(self) -> None:
        push, clear = (
            service("apply_body_wrench", srv.ApplyBodyWrench),
            service("clear_body_wrenches", srv.BodyRequest),
        )
        start = self.place_of("box").x
        force = Wrench(Vector3(60.0, 0.0, 0.0), Vector3())
        assert push("box::body", "world", Point(), force, rospy.Time(), rospy.Duration(0.5)).success
        until(lambda: self.place_of("box").x > start + 0.05, "the box moves")
        until(lambda: self.model("box", "world").twist.linear.x < 0.01, "friction stops it")
        assert push("box::body", "world", Point(), force, rospy.Time(), rospy.Duration(-1)).success
        until(lambda: self.model("box", "world").twist.linear.x > 0.5, "the box is fast")
        clear("box::body")
        until(lambda: self.model("box", "world").twist.linear.x < 0.01, "friction stops it again")
        assert not push(
            "box::lid", "world", Point(), force, rospy.Time(), rospy.Duration(1)
        ).success

    def test_a_link_that_is_put_somewhere_takes_its_model_along(self) -> None:
        put = service("set_link_state", srv.SetLinkState)
        answer = put(LinkState("box::body", at(-2.0, 1.0, 0.25), Twist(), "world"))
        assert answer.success, answer.status_message
        found = self.place_of("box")
        assert (round(found.x, 2), round(found.y, 2)) == (-2.0, 1.0)
        state = service("get_link_state", srv.GetLinkState)("box::body", "pioneer1").link_state
        assert state.reference_frame == "pioneer1"
        assert not put(LinkState("box", at(0.0, 0.0), Twist(), "world")).success

    def test_topics_set_states_as_the_services_do(self) -> None:
        models = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1, latch=True)
        models.publish(ModelState("box", at(0.0, 2.0, 0.25), Twist(), "world"))
        until(lambda: abs(self.place_of("box").y - 2.0) < 0.01, "the box at its new place")
        links = rospy.Publisher("/gazebo/set_link_state", LinkState, queue_size=1, latch=True)
        links.publish(LinkState("box::body", at(0.0, 3.0, 0.25), Twist(), "world"))
        until(lambda: abs(self.place_of("box").y - 3.0) < 0.01, "the box at the place of its link")
        states = rospy.wait_for_message("/gazebo/link_states", LinkStates, PATIENCE)
        assert abs(states.pose[states.name.index("box::body")].position.y - 3.0) < 0.01

    def test_z_reset_simulation_turns_time_back_and_everything_to_its_start(self) -> None:
        until(lambda: self.world().sim_time > 0.5, "some time")
        service("pause_physics", Empty)()
        service("reset_simulation", Empty)()
        assert self.world().sim_time == 0.0
        assert abs(self.place_of("box").x - 3.0) < 0.01
        assert abs(self.place_of("pioneer1").x) < 0.01


if __name__ == "__main__":
    rostest.rosrun("pioneer_gazebo", "interface", InterfaceTest, sys.argv)
