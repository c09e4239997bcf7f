"""The only module of this package that others import. Each function leaves ROS as it is if the switch is off."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from pioneer_launch import launcher, patch
from pioneer_launch.fork_server import lent_server
from pioneer_launch.process_report import REPORT, NodeDeath, begin_report, deaths_in
from pioneer_launch.switch import LOCKSTEP_REFUSED, SwitchedOffError, is_on

__all__ = [
    "LOCKSTEP_REFUSED",
    "REPORT",
    "NodeDeath",
    "Process",
    "StartLauncher",
    "SwitchedOffError",
    "begin_report",
    "close_master_connections",
    "deaths_in",
    "is_on",
    "launcher_starter",
    "patch_master",
    "patch_node",
    "patch_observer",
    "replace_topics",
    "resolved",
    "run",
    "set_ros_time",
    "start",
]


class Process(Protocol):
    """A started program: what ``subprocess.Popen`` and a fork have in common."""

    pid: int

    def poll(self) -> int | None:
        """Returns the exit status; None while it runs."""

    def wait(self, timeout: float) -> int:
        """Waits for the end; returns the status or raises ``subprocess.TimeoutExpired``."""


StartLauncher = Callable[[Sequence[str], Mapping[str, str], int], Process | None]
"""Takes a command, its environment and a descriptor for its output."""


def run(module: str, function: str = "main") -> int | None:
    """Runs the function of a launcher, a program that runs roslaunch; its Python nodes are forks of one interpreter.

    Switched off, roslaunch starts an interpreter for each node.
    """
    return launcher.run(module, function)


def start(command: Sequence[str]) -> Process:
    """Starts a command in a session of its own, without standard input; as a fork, if this process is a launcher."""
    return launcher.started(command)


def resolved(command: Sequence[str]) -> list[str]:
    """Returns a command with ``rosrun`` replaced by the program's path: rosrun would spawn ten processes to find it."""
    return launcher.resolved(command)


def launcher_starter() -> StartLauncher:
    """Returns a function that starts launchers as forks of the interpreter that this process was forked from.

    The function returns None where that is impossible. Call this once in a process.
    """
    return launcher.launcher_starter(lent_server() if is_on() else None)


def patch_node(is_ending: Callable[[], bool], wait: Callable[[float], object]) -> None:
    """Applies the patches of rospy for a node, before it is initialised.

    Args:
        is_ending: returns whether the node is shutting down.
        wait: sleeps for the given seconds, or until shutdown.
    """
    if is_on():
        patch.allow_publishing_at_shutdown()
        patch.log_broken_requests()
        patch.keep_publisher_updates()
        patch.write_at_once()
        patch.stop_serving_at_shutdown()
        patch.keep_accepting(is_ending, wait)


def patch_observer() -> None:
    """Applies the patches of rospy for a program that only subscribes, before it is initialised."""
    if is_on():
        patch.keep_publisher_updates()
        patch.stop_serving_at_shutdown()


def patch_master() -> None:
    """Applies the patches of rosmaster for masters in this process."""
    if is_on():
        patch.wake_master_workers()
        patch.tell_registrations()


def close_master_connections() -> None:
    """Makes masters in this process close their connections to nodes as soon as nothing uses them."""
    if is_on():
        patch.close_master_connections()


def replace_topics(publisher: Any, subscriber: Any, timer: Any, owns_time: bool) -> None:
    """Replaces rospy's classes for topics and timers in this process, for lockstep.

    Args:
        publisher: in place of ``rospy.Publisher``.
        subscriber: in place of ``rospy.Subscriber``.
        timer: in place of ``rospy.Timer``.
        owns_time: whether this process sets ROS time by `set_ros_time` instead of following ``/clock``.

    Raises:
        SwitchedOffError: the switch is off.
    """
    if not is_on():
        raise SwitchedOffError(LOCKSTEP_REFUSED)
    patch.replace_topics(publisher, subscriber, timer)
    if owns_time:
        patch.stop_following_clock()


def set_ros_time(now: Any) -> None:
    """Sets ROS time (rospy.Time) in this process, which `replace_topics` has made its owner."""
    patch.set_ros_time(now)
