"""The controller node between the source of velocity commands and the robot."""

from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.nodes.node_host import run
from pioneer_node.nodes.standing_warning import StandingWarning
from pioneer_ros.conversions import CommandMessage
from pioneer_ros.core.controller import ZERO, CommandError, Watchdog, gains_from_parameters

SILENCE = 0.5
"""Timeout [s of ROS time] of a source whose last command moved the robot."""
_LOOK_EVERY = 0.1  # [s of wall time] while the robot is meant to move


class ControllerNode:
    """Scales velocity commands and forwards them to the robot.

    Subscribes:
        cmd_vel (geometry_msgs/Twist): the command [m/s, rad/s].

    Publishes:
        pioneer/cmd_vel (geometry_msgs/Twist): linear and angular parts times their gains; a single zero command when
        the source has been silent for 0.5 s of ROS time after a command that moved the robot.

    Parameters: ~controller_gains/body/{linear,angular}/p (``core.controller.gains_from_parameters``).

    On error: a non-finite command is dropped with a warning.
    """

    def __init__(self, node: NodeHandle) -> None:
        self._node = node
        self._gains = gains_from_parameters(node.parameters(), node.name)
        self._watchdog = Watchdog(SILENCE)
        self._refusing = StandingWarning("commands are valid again", logger=node.logger)
        self._publisher = node.advertise("pioneer/cmd_vel", CommandMessage)
        self._looks = node.every(_LOOK_EVERY, self._look)
        node.subscribe("cmd_vel", CommandMessage, self._on_command)

    def _look(self) -> None:
        """Stops the robot if the source has been silent for too long."""
        if self._watchdog.expired(self._node.now()):
            self._publisher.publish(CommandMessage(ZERO))
            self._node.logger.warning(
                "no command for %.1f s while the robot was moving: stopped it", SILENCE
            )
        if not self._watchdog.armed:
            self._looks.stop()

    def _on_command(self, message: CommandMessage, _sender: str) -> None:
        try:
            command = self._gains.scaled(message.command)
        except CommandError as error:
            self._refusing.warn(f"command dropped: {error}")
            return
        self._refusing.end()
        self._watchdog.command(command != ZERO, self._node.now())
        self._publisher.publish(CommandMessage(command))
        if self._watchdog.armed:
            self._looks.start()


build = ControllerNode


def main() -> int:
    """Runs the node ``pioneer_ros``; returns the exit status."""
    run("pioneer_ros", build)
