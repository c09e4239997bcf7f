#!/usr/bin/env python3
"""A Gazebo client against the running simulator: topics, services and the spawn script."""

import math
import subprocess
import sys
import tempfile
import threading
import unittest
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from gazebo_msgs import srv
from gazebo_msgs.msg import ModelState, ModelStates
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
from nav_msgs.msg import Odometry
from PIL import Image
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Bool, Float64, UInt32
from std_srvs.srv import Empty, Trigger
from tf2_msgs.msg import TFMessage

PATIENCE = 60.0
START = ("-x", "-1.0", "-y", "-2.0", "-Y", "0.0")


class Listener:
    """Keeps the newest message of a topic and lets a test wait for a matching one."""

    def __init__(self, topic: str, kind: type) -> None:
        self._topic = topic
        self._condition = threading.Condition()
        self.newest: Any = None
        self.count = 0
        self._subscriber = rospy.Subscriber(topic, kind, self._store)

    def _store(self, message: Any) -> None:
        with self._condition:
            self.newest = message
            self.count += 1
            self._condition.notify_all()

    def wait_for(self, wanted: Callable[[Any], bool], what: str) -> Any:
        """Waits for a matching message that arrives after this call, and returns it."""
        with self._condition:
            count = self.count
            fresh = self._condition.wait_for(
                lambda: self.count > count and wanted(self.newest), PATIENCE
            )
            if not fresh:
                raise AssertionError(
                    f"{self._topic}: {what} did not come; the newest is {self.newest}"
                )
            return self.newest


def service(name: str, kind: Any) -> rospy.ServiceProxy:
    rospy.wait_for_service(f"/gazebo/{name}", PATIENCE)
    return rospy.ServiceProxy(f"/gazebo/{name}", kind)


def spawn(model: str, *where: str) -> subprocess.CompletedProcess:
    command = [
        "rosrun",
        "pioneer_gazebo",
        "spawn_model",
        "-urdf",
        "-param",
        "/robot_description",
        "-model",
        model,
    ]
    return subprocess.run(
        [*command, "-robot_namespace", model, *where], capture_output=True, text=True, check=False
    )


class SimulatorTest(unittest.TestCase):
    """One robot, spawned once. After each test, time is running and the robot is back at its start."""

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node("simulator_test", disable_rostime=True)
        rospy.wait_for_message("/gazebo/ready", Bool, PATIENCE)
        done = spawn("pioneer1", *START)
        assert done.returncode == 0, done.stderr
        cls.odometry = Listener("/pioneer1/odom", Odometry)
        cls.truth = Listener("/pioneer1/base_pose_ground_truth", Odometry)
        cls.clock = Listener("/clock", Clock)
        cls.command = rospy.Publisher("/pioneer1/pioneer/cmd_vel", Twist, queue_size=1, latch=True)
        cls.odometry.wait_for(lambda message: True, "odometry")

    def tearDown(self) -> None:
        self.command.publish(Twist())
        service("unpause_physics", Empty)()
        service("reset_world", Empty)()

    def drive(self, speed: float, turn: float) -> None:
        command = Twist()
        command.linear.x, command.angular.z = speed, turn
        self.command.publish(command)

    def test_a_robot_drives_and_its_odometry_agrees_with_the_truth(self) -> None:
        self.drive(0.5, 0.0)
        moved = self.odometry.wait_for(
            lambda odometry: odometry.pose.pose.position.x > 1.0, "a metre of way"
        )
        assert moved.header.frame_id == "pioneer1/odom"
        assert moved.child_frame_id == "pioneer1/base_link"
        assert abs(moved.twist.twist.linear.x - 0.5) < 0.05
        truth = self.truth.wait_for(lambda message: True, "the truth")
        assert truth.header.frame_id == "map"
        assert truth.pose.pose.position.x > -0.1
        assert abs(truth.pose.pose.position.y + 2.0) < 0.05

    def test_a_command_that_is_not_finite_is_ignored(self) -> None:
        self.drive(math.nan, 0.0)
        self.drive(0.3, math.inf)
        self.drive(0.3, 0.0)
        self.odometry.wait_for(lambda odometry: odometry.pose.pose.position.x > 0.3, "way")

    def test_scans_joint_states_and_transforms_arrive(self) -> None:
        scan = rospy.wait_for_message("/pioneer1/base_scan", LaserScan, PATIENCE)
        assert scan.header.frame_id == "pioneer1/laser"
        assert len(scan.ranges) == 180
        assert all(scan.range_min <= reading <= scan.range_max for reading in scan.ranges), (
            "in a closed room"
        )
        states = rospy.wait_for_message("/pioneer1/joint_states", JointState, PATIENCE)
        assert "base_left_wheel_joint" in states.name
        transforms = rospy.wait_for_message("/tf", TFMessage, PATIENCE).transforms
        assert [one.child_frame_id for one in transforms] == ["pioneer1/base_link"]

    def test_time_stands_while_paused_and_steps_when_asked(self) -> None:
        service("pause_physics", Empty)()
        world = service("get_world_properties", srv.GetWorldProperties)
        before = world().sim_time
        assert world().sim_time == before
        assert service("step", Trigger)().success
        assert abs(world().sim_time - (before + 0.02)) < 1e-6
        service("unpause_physics", Empty)()
        self.clock.wait_for(lambda message: message.clock.to_sec() > before + 0.1, "running time")
        assert not service("step", Trigger)().success

    def test_reset_world_puts_the_robot_back_and_never_turns_the_clock_back(self) -> None:
        self.drive(0.5, 0.0)
        self.odometry.wait_for(lambda odometry: odometry.pose.pose.position.x > 0.5, "way")
        self.command.publish(Twist())
        # Topics and services use separate connections: a stop that arrives after the reset finds the robot moving.
        self.odometry.wait_for(
            lambda odometry: abs(odometry.twist.twist.linear.x) < 0.01, "standstill"
        )
        before = service("get_world_properties", srv.GetWorldProperties)().sim_time
        service("reset_world", Empty)()
        assert service("get_world_properties", srv.GetWorldProperties)().sim_time >= before
        self.odometry.wait_for(
            lambda odometry: abs(odometry.pose.pose.position.x) < 0.05, "the origin"
        )
        state = service("get_model_state", srv.GetModelState)("pioneer1", "world")
        assert abs(state.pose.position.x + 1.0) < 0.05

    def test_states_can_be_asked_and_set(self) -> None:
        pose = Pose(Point(0.0, -2.5, 0.01), Quaternion(0.0, 0.0, 0.0, 1.0))
        answer = service("set_model_state", srv.SetModelState)(
            ModelState("pioneer1", pose, Twist(), "world")
        )
        assert answer.success, answer.status_message
        link = service("get_link_state", srv.GetLinkState)(
            "pioneer1::laser", "pioneer1::base_link"
        ).link_state
        assert abs(link.pose.position.z - 0.27) < 0.001
        self.truth.wait_for(
            lambda truth: abs(truth.pose.pose.position.y + 2.5) < 0.02, "the new place"
        )
        states = rospy.wait_for_message("/gazebo/model_states", ModelStates, PATIENCE)
        assert "pioneer1" in states.name
        gone = service("get_model_state", srv.GetModelState)("nobody", "")
        assert not gone.success
        assert "nobody" in gone.status_message

    def test_diagnostics_tell_how_the_simulation_does(self) -> None:
        array = rospy.wait_for_message("/diagnostics", DiagnosticArray, PATIENCE)
        values = {pair.key: pair.value for pair in array.status[0].values}
        assert array.status[0].hardware_id == "pioneer_gazebo"
        assert values["robots"] == "1"
        assert float(values["real-time factor asked for"]) == 1.0
        measured = rospy.wait_for_message("/gazebo/real_time_factor", Float64, PATIENCE).data
        assert 0.0 < measured < 1.5

    def test_a_snapshot_shows_the_robot_headless(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "world.png"
            command = ["rosrun", "pioneer_gazebo", "snapshot", "-o", str(target), "--size", "400"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            assert "1 models that move" in done.stdout
            with Image.open(target) as image:
                assert max(image.size) == 400
                colours = {colour for _, colour in image.getcolors(image.size[0] * image.size[1])}
            assert (214, 69, 65) in colours, "no robot is drawn"

    def test_an_actor_walks_where_it_is_spawned_and_cannot_be_placed(self) -> None:
        person = (Path(__file__).parents[2] / "models" / "walking_person" / "model.sdf").read_text()
        spawn_sdf = service("spawn_sdf_model", srv.SpawnModel)
        answer = spawn_sdf(
            "walker", person, "", Pose(Point(0.0, -3.5, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)), ""
        )
        assert answer.success, answer.status_message
        states = Listener("/gazebo/model_states", ModelStates)

        def on_its_way(message: ModelStates) -> bool:
            index = message.name.index("walker")
            return message.pose[index].position.x > 0.5 and message.twist[index].linear.x > 0.3

        walking = states.wait_for(on_its_way, "half a metre of way")
        assert abs(walking.pose[walking.name.index("walker")].position.y + 3.5) < 1e-6
        refused = service("set_model_state", srv.SetModelState)(
            ModelState("walker", Pose(), Twist(), "world")
        )
        assert "follows its script" in refused.status_message
        assert service("delete_model", srv.DeleteModel)("walker").success

    def test_bad_spawns_are_refused_in_one_line_and_the_simulator_continues(self) -> None:
        again = spawn("pioneer1", *START)
        assert again.returncode == 1
        assert "already exists" in again.stderr + again.stdout
        overlapping = spawn("pioneer2", *START)
        assert "overlap pioneer1" in overlapping.stderr + overlapping.stdout
        broken = service("spawn_urdf_model", srv.SpawnModel)("pioneer3", "<robot", "", Pose(), "")
        assert not broken.success
        assert "\n" not in broken.status_message
        broken = service("spawn_sdf_model", srv.SpawnModel)("box", "<sdf/>", "", Pose(), "")
        assert not broken.success
        self.odometry.wait_for(lambda message: True, "odometry")

    def test_a_robot_is_deleted_while_it_drives_and_takes_its_topics_along(self) -> None:
        done = spawn("pioneer2", "-x", "3.0", "-y", "-3.0")
        assert done.returncode == 0, done.stderr
        collisions = rospy.wait_for_message("/pioneer2/collisions", UInt32, PATIENCE)
        assert collisions.data == 0
        command = rospy.Publisher("/pioneer2/pioneer/cmd_vel", Twist, queue_size=1, latch=True)
        driving = Twist()
        driving.linear.x = 0.3
        command.publish(driving)
        other = Listener("/pioneer2/odom", Odometry)
        other.wait_for(lambda odometry: odometry.pose.pose.position.x > 0.1, "way")
        assert service("delete_model", srv.DeleteModel)("pioneer2").success
        assert not service("delete_model", srv.DeleteModel)("pioneer2").success
        assert "/pioneer2/odom" not in [
            topic for topic, _ in rospy.get_published_topics("/pioneer2")
        ]
        self.odometry.wait_for(lambda message: True, "odometry of the one that stays")


if __name__ == "__main__":
    rostest.rosrun("pioneer_gazebo", "simulator", SimulatorTest, sys.argv)
