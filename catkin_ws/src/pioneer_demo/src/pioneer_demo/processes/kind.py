"""Classifies processes by their command line."""

import os
from collections.abc import Sequence

OTHER = "other"
COMMAND = "start-up commands"
"""Short-lived processes: flips, xacro, rosrun and their children."""

_NAMES = {
    "simulator": "gazebo",
    "gateways": "gateway",
    "hub and redis": "hub redis-server",
    "amcl": "amcl",
    "move_base": "move_base",
    "slam_gmapping": "slam_gmapping",
    "masters": "rosmaster rosout",
    "roslaunch": "roslaunch run-multi-pioneer-gazebo-master run-pioneer-nav-local run-pioneer-hub fork_server",
    "map server": "map_server",
    "recorder": "pioneer_fleet.recording.recorder",
    "fleet page": "fleet_page",
    "robot state publishers": "robot_state_publisher robot_state_publishers",
    "waypoint clients, control": "light_nodes map_goal_client pioneer_ros controller_spin_recover",
    COMMAND: "advertise-from-hub pull-from-hub flip-from-hub flip-from-remote "
    "rosrun catkin_find rosversion xacro find uniq",
}
_KINDS = {name: kind for kind, names in _NAMES.items() for name in names.split()}


def kind(argv: Sequence[str]) -> str:
    """Returns the part of the system that a command line belongs to; ``other`` if unknown."""
    return next((_KINDS[name] for name in _names(argv) if name in _KINDS), OTHER)


def _names(argv: Sequence[str]) -> list[str]:
    """Returns a process's names as ROS node, script and program (Redis rewrites its first argument)."""
    node = [word.removeprefix("__name:=") for word in argv if word.startswith("__name:=")]
    scripts = [os.path.basename(word) for word in argv[1:2] if not word.startswith("-")]
    scripts += argv[2:3] if list(argv[1:2]) == ["-m"] else []
    program = [os.path.basename(word.split(" ")[0]) for word in argv[:1]]
    return node + scripts + program
