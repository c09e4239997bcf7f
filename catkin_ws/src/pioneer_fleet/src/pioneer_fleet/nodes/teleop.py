"""``teleop``: drives one robot by keyboard through the robot's master."""

import argparse
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator

import rosgraph
import rospy
from geometry_msgs.msg import Twist

from pioneer_fleet.core.steering import Steering

_RATE = 10.0
"""Command rate [Hz]: a robot stops 0.6 s after the last command."""
_HELP = "w/s faster/slower, a/d left/right, space stops, q ends; while move_base has a goal it commands the robot, too"


def main() -> int:
    """Runs the command; returns its exit status."""
    parser = argparse.ArgumentParser(
        "teleop",
        description="Drives a robot by keyboard: publishes ROBOT/cmd_vel on the robot's master.",
        epilog="example: rosrun pioneer_fleet teleop pioneer1",
    )
    parser.add_argument("robot", help="its name, such as pioneer1")
    robot = parser.parse_args(rospy.myargv(sys.argv)[1:]).robot
    if not sys.stdin.isatty():
        sys.stderr.write("teleop: standard input must be a terminal\n")
        return 2
    if not rosgraph.is_master_online():
        sys.stderr.write(f"teleop: no ROS master at {os.environ.get('ROS_MASTER_URI')}; is the fleet running?\n")
        return 1
    rospy.init_node("teleop", anonymous=True, disable_rostime=True)
    publisher = rospy.Publisher(f"/{robot}/cmd_vel", Twist, queue_size=1)
    sys.stdout.write(f"{robot}: {_HELP}\n")
    for steering in _steered():
        command = Twist()
        command.linear.x, command.angular.z = steering.linear, steering.angular
        publisher.publish(command)
        listening = "" if publisher.get_num_connections() else f"   nothing subscribes to /{robot}/cmd_vel"
        sys.stdout.write(f"\r\033[K{steering.linear:+.1f} m/s  {steering.angular:+.1f} rad/s{listening}")
        sys.stdout.flush()
    sys.stdout.write("\n")
    return 0


def _steered() -> Iterator[Steering]:
    """Yields the speed to command ten times a second until q is pressed; the last one is zero."""
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin, termios.TCSADRAIN)  # keeps pending input
    steering = Steering()
    try:
        while not rospy.is_shutdown():
            if select.select([sys.stdin], [], [], 1 / _RATE)[0]:
                key = os.read(sys.stdin.fileno(), 1).decode(errors="replace")
                if key in ("q", ""):
                    break
                steering = steering.after(key)
            yield steering
        yield Steering()
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
