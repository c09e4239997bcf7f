"""Classifies processes by their command line."""

import os
from collections.abc import Sequence

OTHER = "other"
COMMAND = "start-up commands"
"""Short-lived processes: flips, xacro, rosrun and their children."""

_BY_NAME = {
    "gazebo": "simulator",
    "gateway": "gateways",
    "hub": "hub and redis",
    "redis-server": "hub and redis",
    "amcl": "amcl",
    "move_base": "move_base",
    "slam_gmapping": "slam_gmapping",
    "rosmaster": "masters",
    "rosout": "masters",
    "roslaunch": "roslaunch",
    "run-multi-pioneer-gazebo-master": "roslaunch",
    "run-pioneer-nav-local": "roslaunch",
    "run-pioneer-hub": "roslaunch",
    "fork_server": "roslaunch",
    "map_server": "map server",
    "pioneer_fleet.adapters.recorder": "recorder",
    "fleet_page": "fleet page",
    "robot_state_publisher": "robot state publishers",
    "robot_state_publishers": "robot state publishers",
    "light_nodes": "waypoint clients, control",
    "map_goal_client": "waypoint clients, control",
    "pioneer_ros": "waypoint clients, control",
    "controller_spin_recover": "waypoint clients, control",
    **dict.fromkeys(("advertise-from-hub", "pull-from-hub", "flip-from-hub", "flip-from-remote"), COMMAND),
    **dict.fromkeys(("rosrun", "catkin_find", "rosversion", "xacro", "find", "uniq"), COMMAND),
}


def kind(argv: Sequence[str]) -> str:
    """Returns the part of the system that a command line belongs to; ``other`` if unknown."""
    for name in _names(argv):
        if name in _BY_NAME:
            return _BY_NAME[name]
    return OTHER


def _names(argv: Sequence[str]) -> list[str]:
    """Returns a process's names as ROS node, script and program (Redis rewrites its first argument)."""
    node = [word.removeprefix("__name:=") for word in argv if word.startswith("__name:=")]
    scripts = [os.path.basename(word) for word in argv[1:2] if not word.startswith("-")]
    scripts += argv[2:3] if list(argv[1:2]) == ["-m"] else []
    program = [os.path.basename(word.split(" ")[0]) for word in argv[:1]]
    return node + scripts + program
