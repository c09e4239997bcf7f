"""Defines the gateway rules of the fleet and of single topics.

Contains all names fixed by the tutorial: which topics are forwarded, between which gateways, for which nodes.
"""

import enum
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

HUB_GATEWAY = "Hub_Gateway"
SHARED_TOPICS = ("clock", "map", "tf", "tf_static")
LASER_TOPIC, ODOMETRY_TOPIC = "base_scan", "odom"
COMMAND_TOPIC = "pioneer/cmd_vel"
VIEWED_TOPICS = (
    "move_base/current_goal",
    "move_base/local_costmap/costmap",
    "move_base/local_costmap/costmap_updates",
    "move_base/NavfnROS/plan",
    "move_base/TrajectoryPlannerROS/local_plan",
)
ANY_NODE = ""
TOOLS_NODE = "/rviz.*"
TOOL_TOPICS = ("map_goal_pose", "initialpose")
ROS2_NODE = "/ros2_door.*"
ROS2_READ_TOPICS = (
    *VIEWED_TOPICS,
    "amcl_pose",
    "particlecloud",
    "move_base/TrajectoryPlannerROS/global_plan",
    "move_base/local_costmap/footprint",
    "move_base/global_costmap/costmap",
    "move_base/global_costmap/costmap_updates",
    "move_base/global_costmap/footprint",
)
ROS2_WRITTEN_TOPICS = (
    "map_goal",
    "map_goal_pose",
    "initialpose",
    "map_goal_client/cancel",
    "move_base/cancel",
)
REPORT_TOPIC, ROBOT_GATEWAYS = "/traffic/reports", "aadi.*_gateway"
PING, PONG = "/handshake/ping", "/handshake/pong"
DEFAULT_ROBOTS = 15


class RuleSetError(ValueError):
    """The command line or environment is invalid; the message says what to give."""


class Action(enum.StrEnum):
    """A request to the gateway; the value is the name of its service."""

    ADVERTISE = "advertise"
    PULL = "pull"
    FLIP = "flip"


@dataclass(frozen=True, slots=True)
class Wish:
    """One rule to request from the gateway."""

    #: "publisher" or "subscriber", as seen from this gateway for a flip, from the other for a pull; or "parameter"
    kind: str
    name: str  #: the topic, or a pattern
    node: str = ""  #: the node, or a pattern; empty for any
    gateway: str = ""  #: the other gateway; empty for an advertisement

    def __str__(self) -> str:
        return ", ".join(part for part in (self.gateway, self.name, self.kind, self.node) if part)


WORLD = Wish("parameter", "/world_name")
"""Set by step 3; step 4 derives the robot's initial pose from it."""


def advertised_by_hub() -> list[Wish]:
    """Returns the rules that the hub's gateway advertises."""
    return [*(Wish("publisher", f"/{topic}") for topic in SHARED_TOPICS), WORLD]


def pulled_from_hub(gateway: str = HUB_GATEWAY) -> list[Wish]:
    """Returns the rules that a robot pulls."""
    return [replace(wish, gateway=gateway) for wish in advertised_by_hub()]


def flipped_from_hub(robots: Sequence[str], node: str = ANY_NODE) -> list[Wish]:
    """Returns the hub gateway's flips that let `node` there see `robots`; the first robot is on aadi1, and so on."""
    return [
        Wish("subscriber", topic, node, f"aadi{number}_gateway")
        for number, robot in enumerate(robots, 1)
        for topic in ("/tf", *(topic_in(robot, topic) for topic in VIEWED_TOPICS))
    ]


def flipped_by_tools(robots: Sequence[str]) -> list[Wish]:
    """Returns the hub gateway's flips that let RViz's goal and initial-pose tools reach `robots`."""
    return [
        Wish("publisher", topic_in(robot, topic), TOOLS_NODE, f"aadi{number}_gateway")
        for number, robot in enumerate(robots, 1)
        for topic in TOOL_TOPICS
    ]


def flipped_for_ros2(robots: Sequence[str]) -> list[Wish]:
    """Returns the hub gateway's flips that let the door to ROS 2 on its master read and command `robots`."""
    wishes: list[Wish] = []
    for number, robot in enumerate(robots, 1):
        gateway = f"aadi{number}_gateway"
        wishes.append(Wish("subscriber", "/tf", ROS2_NODE, gateway))
        wishes += [
            Wish("subscriber", topic_in(robot, topic), ROS2_NODE, gateway)
            for topic in ROS2_READ_TOPICS
        ]
        wishes += [
            Wish("publisher", topic_in(robot, topic), ROS2_NODE, gateway)
            for topic in ROS2_WRITTEN_TOPICS
        ]
    return wishes


def flipped_from_robot(
    robot: str, laser: str = LASER_TOPIC, gateway: str = HUB_GATEWAY
) -> list[Wish]:
    """Returns a robot's flips: its sensors to this gateway, its commands to the hub."""
    sensors = [
        Wish("subscriber", topic_in(robot, topic), gateway=gateway)
        for topic in (laser, ODOMETRY_TOPIC)
    ]
    return [*sensors, Wish("publisher", topic_in(robot, COMMAND_TOPIC), gateway=gateway)]


def flipped_topic(kind: str, topic: str, gateway: str) -> Wish:
    """Returns the flip of one topic, of any node, to a gateway: `Hub_Gateway` or `aadi1_gateway`, `aadi1` for short."""
    full = gateway if gateway.lower().endswith("gateway") else f"{gateway}_gateway"
    return Wish(kind, topic_in("", topic), gateway=full)


def flipped_for_traffic() -> list[Wish]:
    """Returns a robot's flip to all other robots, present or future, for right-of-way coordination."""
    return [Wish("publisher", REPORT_TOPIC, gateway=ROBOT_GATEWAYS)]


def flipped_for_lockstep(robot: str, gateway: str = HUB_GATEWAY) -> list[Wish]:
    """Returns a robot's flips for lockstep with the simulator: tokens and probes to here, finished tokens back."""
    here = [
        Wish("subscriber", topic_in(robot, f"lockstep/{name}"), gateway=gateway)
        for name in ("period", "probe")
    ]
    return [*here, Wish("publisher", topic_in(robot, "lockstep/done"), gateway=gateway)]


def handshake(gateway: str) -> list[Wish]:
    """Returns the flips of `test_sender`: one topic to `gateway`, one back from there."""
    return [Wish("publisher", PING, gateway=gateway), Wish("subscriber", PONG, gateway=gateway)]


def topic_in(namespace: str, topic: str) -> str:
    """Returns a topic in a namespace; an absolute topic is unchanged."""
    if topic.startswith("/"):
        return topic
    namespace = namespace.strip("/")
    return f"/{namespace}/{topic}" if namespace else f"/{topic}"


def node_named(node: str) -> str:
    """Returns a node's name with a leading slash; empty stays empty."""
    return f"/{node.lstrip('/')}" if node else ""


def robot_names(arguments: list[str], environment: Mapping[str, str]) -> list[str]:
    """Returns the robots' names: the arguments, or pioneer1 … pioneerN, N from the argument, else ROBOTS, else 15.

    Raises:
        RuleSetError: N is not a valid number.
    """
    text = arguments[0] if arguments else environment.get("ROBOTS") or str(DEFAULT_ROBOTS)
    if arguments and text[:1].isalpha():
        return arguments
    if not text.isdigit() or not 0 < int(text) <= 1000:
        raise RuleSetError(f"'{text}' is not a number of robots; give one, or set ROBOTS")
    return [f"pioneer{number}" for number in range(1, int(text) + 1)]


def robot_name(arguments: list[str], environment: Mapping[str, str], host: str) -> str:
    """Returns the robot's name: the first argument, else ROBOT_NAME, else pioneerX on host aadiX.

    Raises:
        RuleSetError: none of these gives a name.
    """
    name = arguments[0] if arguments else environment.get("ROBOT_NAME", "")
    if name:
        return name
    found = re.match(r"aadi(\d+)(\.|$)", environment.get("HOSTNAME") or host)
    if not found:
        raise RuleSetError(f"set ROBOT_NAME (pioneer1, …): the host's name '{host}' is not aadiX")
    return f"pioneer{found[1]}"
