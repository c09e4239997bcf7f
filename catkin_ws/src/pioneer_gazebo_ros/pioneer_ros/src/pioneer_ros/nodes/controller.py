"""The controller between the source of velocity commands and the robot."""

import threading

import rospy

from pioneer_node.nodes.entry import on_shutdown, parameters, run
from pioneer_node.nodes.standing_warning import StandingWarning
from pioneer_ros.conversions import CommandMessage, message_from_command
from pioneer_ros.core.controller import ZERO, CommandError, Watchdog, gains_from_parameters

SILENCE = 0.5
"""Longest silence [s of ROS time] of a source that last commanded movement."""
_LOOK_EVERY = 0.1  # [s of wall time] while the watchdog is armed


class ControllerNode:
    """Scales velocity commands and passes them on to the robot.

    Subscribes:
        cmd_vel (geometry_msgs/Twist): the command [m/s, rad/s].

    Publishes:
        pioneer/cmd_vel (geometry_msgs/Twist): linear and angular parts times their gains; one zero when the source
        has been silent for 0.5 s of ROS time while the last command moved the robot.

    Parameters: ~controller_gains/body/{linear,angular}/p (``core.controller.gains_from_parameters``).

    Threads: rospy's subscriber thread passes commands on; ``spin`` watches for silence, and sleeps while the robot
    is meant to stand.

    On error: a command that is not finite is dropped with a warning.
    """

    def __init__(self) -> None:
        self._gains = gains_from_parameters(parameters(), rospy.get_name())
        self._watchdog = Watchdog(SILENCE)
        self._armed = threading.Condition()
        self._refusing = StandingWarning("commands are valid again")
        self._publisher = rospy.Publisher("pioneer/cmd_vel", CommandMessage, queue_size=1, tcp_nodelay=True)
        on_shutdown(self._wake)
        rospy.Subscriber("cmd_vel", CommandMessage, self._on_command, queue_size=1, tcp_nodelay=True)

    def spin(self) -> None:
        """Watches for silence until shutdown."""
        while not rospy.is_shutdown():
            with self._armed:
                if not rospy.is_shutdown():
                    self._armed.wait(_LOOK_EVERY if self._watchdog.armed else None)
                if rospy.is_shutdown():
                    return
            self.step()

    def step(self) -> None:
        """Stops the robot if the source has been silent for too long."""
        with self._armed:
            if not self._watchdog.expired(rospy.get_time()):
                return
            self._publisher.publish(message_from_command(ZERO))
        rospy.logwarn("no command for %.1f s while the robot was moving: stopped it", SILENCE)

    def _on_command(self, message: CommandMessage) -> None:
        try:
            command = self._gains.scaled(message.command)
        except CommandError as error:
            self._refusing.warn(f"command dropped: {error}")
            return
        self._refusing.end()
        with self._armed:
            was_armed = self._watchdog.armed
            self._watchdog.command(command != ZERO, rospy.get_time())
            self._publisher.publish(message_from_command(command))
            if self._watchdog.armed != was_armed:
                self._armed.notify()

    def _wake(self) -> None:
        with self._armed:
            self._armed.notify()


def main() -> int:
    """Runs the node ``pioneer_ros`` and returns its exit status."""
    return run("pioneer_ros", ControllerNode)
