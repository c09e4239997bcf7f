"""``learned_driver``: drives a robot to goals with weights learned in the simulator's learning environments."""

import argparse
import json
import math
from pathlib import Path

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import Twist
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from pioneer_gazebo.learning.heading_policy import act
from pioneer_gazebo.world.resource import package_directory

FASTEST, QUICKEST = 0.7, 1.5
"""Maximum speed and turn rate, as in training [m/s, rad/s]."""


class LearnedDriver:
    """Answers each scan with a velocity command until all goals are reached.

    Subscribes: ``base_scan`` (sensor_msgs/LaserScan, 360°), /tf from map to the robot's base_link.

    Publishes: ``cmd_vel`` (geometry_msgs/Twist).
    """

    def __init__(
        self, weights: NDArray[np.float64], goals: list[tuple[float, float]], tolerance: float
    ) -> None:
        """Takes the policy's weights, and goals x, y [m] in map, which are reached within ``tolerance`` [m]."""
        self._weights, self._goals, self._tolerance = weights, goals, tolerance
        self._base = f"{rospy.get_namespace().strip('/')}/base_link".lstrip("/")
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)
        self._commands = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self._scans = rospy.Subscriber("base_scan", LaserScan, self._on_scan, queue_size=1)

    def _on_scan(self, scan: LaserScan) -> None:
        try:
            transform = self._buffer.lookup_transform("map", self._base, rospy.Time()).transform
        except tf2_ros.TransformException:
            return  # not localised yet
        where, turned = transform.translation, transform.rotation
        yaw = math.atan2(
            2.0 * (turned.w * turned.z + turned.x * turned.y),
            1.0 - 2.0 * (turned.y**2 + turned.z**2),
        )
        if self._goals and math.dist((where.x, where.y), self._goals[0]) <= self._tolerance:
            rospy.loginfo(
                "reached (%.2f, %.2f), at (%.2f, %.2f)", *self._goals.pop(0), where.x, where.y
            )
        if not self._goals:
            self._commands.publish(Twist())
            rospy.signal_shutdown("all goals are reached")
            return
        x, y = self._goals[0]
        bearing = math.remainder(math.atan2(y - where.y, x - where.x) - yaw, math.tau)
        ranges = np.nan_to_num(np.asarray(scan.ranges), nan=scan.range_max, posinf=scan.range_max)
        speed, turn = act(self._weights, ranges, math.dist((where.x, where.y), (x, y)), bearing)
        command = Twist()
        command.linear.x, command.angular.z = FASTEST * speed, QUICKEST * turn
        self._commands.publish(command)


def main() -> int:
    """Drives to the goals given on the command line; returns the exit status."""
    shipped = (package_directory("pioneer_gazebo") or Path()) / "config" / "learned_driver.json"
    parser = argparse.ArgumentParser(
        prog="learned_driver", description="Drives a robot to goals in map by a learned policy."
    )
    parser.add_argument(
        "--weights", type=Path, default=shipped, metavar="FILE", help="default: %(default)s"
    )
    parser.add_argument(
        "--tolerance", type=float, default=0.3, metavar="M", help="default: %(default)s m"
    )
    parser.add_argument("goals", type=float, nargs="+", metavar="X Y", help="one or more")
    options = parser.parse_args(rospy.myargv()[1:])
    if len(options.goals) % 2:
        parser.error("goals are pairs of x and y")
    rospy.init_node("learned_driver")
    weights = np.array(json.loads(options.weights.read_text())["weights"])
    LearnedDriver(
        weights, list(zip(options.goals[::2], options.goals[1::2], strict=True)), options.tolerance
    )
    rospy.spin()
    return 0
