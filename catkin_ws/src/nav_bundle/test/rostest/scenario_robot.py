"""One robot of a scenario: its actions, and what the test observes of it. Times are simulated seconds."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import rospy
from actionlib_msgs.msg import GoalID
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult, RecoveryStatus
from nav_msgs.msg import Odometry
from nav_msgs.srv import GetPlan
from scenario_world import START_UP, World
from sensor_msgs.msg import LaserScan
from std_msgs.msg import UInt32
from std_srvs.srv import Empty
from wanderer import Wanderer

from nav_bundle.base.conversions import message_from_pose, pose_from_message
from nav_bundle.base.pose import Pose
from nav_bundle.base.topics import TransformListener
from nav_bundle.base.transform import TransformError

LONGEST_LAG = 0.5
"""How long a ground truth waits for the pose estimate of its stamp [s of wall time]; then it is skipped."""
PLACING = 30.0
"""Timeout for placing and localising a robot; this is set-up, not a tested bound."""
RIGHT = 0.3
"""A pose estimate within this distance of the truth [m] is right."""
SURE = 5.0
"""A robot whose estimate is right for this long is localised."""


class Robot:
    """One robot: ground truth, pose estimate and navigation."""

    def __init__(self, name: str, world: World) -> None:
        self.name, self.world = name, world
        self.truth, self.stamp = Pose(), 0.0
        self.error, self.compared, self._right_since = math.inf, 0.0, math.inf
        self.collisions = 0
        self.recoveries: list[str] = []
        self.result: MoveBaseActionResult | None = None
        self._goal = ""
        self._listener = TransformListener()
        self._listener.listen("map", f"{name}/base_link")
        services = {
            "move_base/clear_costmaps": Empty,
            "move_base/make_plan": GetPlan,
            "global_localization": Empty,
        }
        for service in services:
            rospy.wait_for_service(f"/{name}/{service}", START_UP)
        self._forget, self._make_plan, self._scatter = (
            rospy.ServiceProxy(f"/{name}/{service}", kind) for service, kind in services.items()
        )
        self._goals = rospy.Publisher(f"/{name}/move_base/goal", MoveBaseActionGoal, queue_size=1)
        self._cancels = rospy.Publisher(f"/{name}/move_base/cancel", GoalID, queue_size=1)
        self._told = rospy.Publisher(
            f"/{name}/initialpose", PoseWithCovarianceStamped, queue_size=1
        )
        self._drive = rospy.Publisher(f"/{name}/pioneer/cmd_vel", Twist, queue_size=1)
        rospy.Subscriber(f"/{name}/base_pose_ground_truth", Odometry, self._on_truth, queue_size=1)
        rospy.Subscriber(f"/{name}/collisions", UInt32, self._on_collisions)
        rospy.Subscriber(f"/{name}/move_base/result", MoveBaseActionResult, self._on_result)
        rospy.Subscriber(f"/{name}/move_base/recovery_status", RecoveryStatus, self._on_recovery)

    def _on_truth(self, message: Odometry) -> None:
        self.truth, self.stamp = pose_from_message(message.pose.pose), message.header.stamp.to_sec()
        truth, stamp = self.truth, self.stamp
        try:
            belief = self._listener.wait(
                "map", f"{self.name}/base_link", stamp, LONGEST_LAG
            ).planar()
        except TransformError:
            return
        with self.world.changed:
            self.error, self.compared = belief.distance(truth), stamp
            self._right_since = min(self._right_since, stamp) if self.error < RIGHT else math.inf

    def _on_collisions(self, message: UInt32) -> None:
        self.collisions = message.data

    def _on_result(self, message: MoveBaseActionResult) -> None:
        if message.status.goal_id.id == self._goal:
            self.result = message

    def _on_recovery(self, message: RecoveryStatus) -> None:
        self.recoveries.append(message.recovery_behavior_name)

    def up(self) -> bool:
        """Returns whether the robot is localised and its nodes accept commands."""
        publishers = (self._goals, self._cancels, self._told, self._drive)
        return self.error < 1.0 and all(publisher.get_num_connections() for publisher in publishers)

    def place(self, pose: Pose) -> None:
        """Teleports the robot, publishes its initial pose, waits until it is localised, and clears its costmaps."""
        self.carry(pose)
        since = self.world.time
        told = PoseWithCovarianceStamped()
        told.header.frame_id = "map"
        told.pose.pose = message_from_pose(pose)
        told.pose.covariance[0] = told.pose.covariance[7] = 0.01
        told.pose.covariance[35] = 0.01
        self._told.publish(told)
        self.world.wait(
            lambda: self.compared > since and self.error < 0.1,
            f"{self.name} believing where it is",
            PLACING,
        )
        self._forget()

    def carry(self, pose: Pose) -> None:
        """Teleports the robot without publishing an initial pose."""
        self.world.put(self.name, pose)
        since = self.world.time
        self.world.wait(
            lambda: self.stamp > since and self.truth.distance(pose) < 0.1,
            f"{self.name} at its place",
            PLACING,
        )

    def recover(self, slow: float, fast: float) -> None:
        """Sets amcl's recovery_alpha_slow and recovery_alpha_fast; zeros disable recovery."""
        client = Client(f"/{self.name}/amcl", timeout=START_UP)
        client.update_configuration({"recovery_alpha_slow": slow, "recovery_alpha_fast": fast})
        client.close()

    def lose(self) -> None:
        """Spreads amcl's particles over the whole map."""
        self._scatter()

    def wander_until_found(self, limit: float) -> None:
        """Lets the robot wander by laser until its pose estimate has been right for ``SURE``."""
        with self.world.changed:
            self._right_since = math.inf
        with self._wandering():
            self.world.wait(
                lambda: self.compared - self._right_since > SURE,
                f"{self.name} knowing where it is",
                limit + SURE,
            )

    @contextmanager
    def _wandering(self) -> Iterator[None]:
        wanderer = Wanderer()

        def on_scan(scan: LaserScan) -> None:
            bearings = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            command = Twist()
            command.linear.x, command.angular.z = wanderer.command(np.array(scan.ranges), bearings)
            self._drive.publish(command)

        scans = rospy.Subscriber(
            f"/{self.name}/base_scan", LaserScan, on_scan, queue_size=1, tcp_nodelay=True
        )
        try:
            yield
        finally:
            scans.unregister()
            self.halt()

    def send(self, x: float, y: float) -> None:
        """Sends a goal to move_base."""
        self.result, self._goal = None, f"{x} {y} {self.world.time}"
        message = MoveBaseActionGoal()
        message.goal_id.id = self._goal
        message.goal.target_pose = _stamped(Pose(x, y))
        self._goals.publish(message)

    def sees_a_way(self, x: float, y: float) -> bool:
        """Returns whether move_base's make_plan finds a path. move_base must not have a goal."""
        return bool(self._make_plan(PoseStamped(), _stamped(Pose(x, y)), 0.0).plan.poses)

    def halt(self) -> None:
        """Stops the robot and cancels its goals."""
        self._drive.publish(Twist())
        self._cancels.publish(GoalID())


def _stamped(pose: Pose) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id, message.pose = "map", message_from_pose(pose)
    return message
