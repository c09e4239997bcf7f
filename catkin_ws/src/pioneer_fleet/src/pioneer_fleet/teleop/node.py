"""``teleop``: drives one robot by keyboard through the robot's master."""

import argparse
import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator

import rosgraph
import rospy
from geometry_msgs.msg import Twist

from pioneer_fleet.printable import printable
from pioneer_fleet.teleop.steering import Steering
from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.forced_end import ForcedEnd

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
    terminal = termios.tcgetattr(sys.stdin.fileno())
    end = ForcedEnd(
        signal.SIGINT,
        signal.SIGTERM,
        signal.SIGHUP,
        before=lambda: termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, terminal),
    )
    if not rosgraph.is_master_online():
        sys.stderr.write(
            f"teleop: no ROS master at {os.environ.get('ROS_MASTER_URI')}; is the fleet running?\n"
        )
        return 1
    # rospy would close the publisher before the robot has been stopped.
    rospy.init_node("teleop", anonymous=True, disable_rostime=True, disable_signals=True)
    publisher = rospy.Publisher(f"/{robot}/cmd_vel", Twist, queue_size=1)
    shown = printable(robot, "")
    sys.stdout.write(f"{shown}: {_HELP}\n")
    for steering in _steered(end):
        command = Twist()
        command.linear.x, command.angular.z = steering.linear, steering.angular
        publisher.publish(command)
        listening = (
            "" if publisher.get_num_connections() else f"   nothing subscribes to /{shown}/cmd_vel"
        )
        sys.stdout.write(
            f"\r\033[K{steering.linear:+.1f} m/s  {steering.angular:+.1f} rad/s{listening}"
        )
        sys.stdout.flush()
    sys.stdout.write("\n")
    rospy.signal_shutdown("ended by its user")
    return 128 + end.number if end.number else 0


def _steered(end: EndRequest) -> Iterator[Steering]:
    """Yields the speed to command ten times a second until q is pressed or the end is requested; then zero."""
    keyboard = sys.stdin.fileno()
    before = termios.tcgetattr(keyboard)
    tty.setcbreak(keyboard, termios.TCSADRAIN)  # keeps pending input
    steering = Steering()
    try:
        while not end.wait(1 / _RATE, beside=(keyboard,)):
            if select.select([keyboard], [], [], 0.0)[0]:
                key = os.read(keyboard, 1).decode(errors="replace")
                if key in ("q", ""):
                    break
                steering = steering.after(key)
            yield steering
        # rospy sends in a thread of its own: the second command leaves once the first has been taken.
        yield Steering()
        select.select([], [], [], 1 / _RATE)
        yield Steering()
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
