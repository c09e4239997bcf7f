"""Implements this package's scripts by name: `run` parses the command line and returns an exit status."""

import argparse
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import rospy

from rocon_flip import rule_set
from rocon_flip.gateway_client import GatewayClient
from rocon_flip.rule_set import Action, RuleSetError, Wish


class Script(NamedTuple):
    """A script with positional arguments."""

    action: Action  #: its request to the gateway
    wishes: Callable[[list[str]], list[Wish]]  #: returns the rules for its arguments
    usage: str = ""  #: usage text; it also determines which options of `_SHARED` are allowed
    least: int = 0  #: minimum number of arguments
    most: int = 0  #: maximum number of arguments


def _seen_at_hub(arguments: list[str]) -> list[Wish]:
    """Returns flips of what RViz on the hub shows, for any node or the given one."""
    nodes = [one for one in arguments if one.startswith("/")]
    robots = [one for one in arguments if one not in nodes]
    return rule_set.flipped_from_hub(rule_set.robot_names(robots, os.environ), *nodes[:1])


def _used_at_hub(arguments: list[str]) -> list[Wish]:
    """Returns flips of goals and initial poses set in RViz on the hub."""
    return rule_set.flipped_by_tools(rule_set.robot_names(arguments, os.environ))


def _through_ros2_door(arguments: list[str]) -> list[Wish]:
    """Returns flips of what the door to ROS 2 reads and commands."""
    return rule_set.flipped_for_ros2(rule_set.robot_names(arguments, os.environ))


def _of_robot(arguments: list[str]) -> list[Wish]:
    """Returns flips of a robot's sensors and commands."""
    robot = rule_set.robot_name(arguments, os.environ, socket.gethostname())
    return rule_set.flipped_from_robot(robot, *arguments[1:])


def _token_of_robot(arguments: list[str]) -> list[Wish]:
    """Returns flips of the lockstep tokens between the simulator and a robot's nodes."""
    return rule_set.flipped_for_lockstep(
        rule_set.robot_name(arguments, os.environ, socket.gethostname())
    )


def _publisher(arguments: list[str], gateway: str = "") -> list[Wish]:
    return [Wish("publisher", rule_set.topic_in("", arguments[0]), gateway=gateway)]


def _flipped_at_hub(arguments: list[str], kind: str) -> list[Wish]:
    """Returns one flip to a robot's host (`aadi1`); with two arguments, as published originally, to any gateway."""
    if len(arguments) == 2:
        return [rule_set.flipped_topic(kind, *arguments)]
    if len(arguments) == 3:
        raise RuleSetError(f"3 arguments are ambiguous; usage: {_AT_HUB}")
    namespace, topic, node, host = arguments
    return [
        Wish(
            kind, rule_set.topic_in(namespace, topic), rule_set.node_named(node), f"{host}_gateway"
        )
    ]


def _flipped_at_robot(arguments: list[str], kind: str) -> list[Wish]:
    """Returns a single flip to the hub."""
    namespace, topic, node = arguments
    return [
        Wish(
            kind,
            rule_set.topic_in(namespace, topic),
            rule_set.node_named(node),
            rule_set.HUB_GATEWAY,
        )
    ]


_AT_HUB, _AT_ROBOT = "namespace topic node gate | topic gateway", "namespace topic node"
_SCRIPTS: Mapping[str, Script] = {
    "advertise-from-hub": Script(Action.ADVERTISE, lambda _: rule_set.advertised_by_hub()),
    "pull-from-hub": Script(Action.PULL, lambda _: rule_set.pulled_from_hub()),
    "flip-from-hub": Script(
        Action.FLIP, _seen_at_hub, "[--advertise] [ROBOTS | ROBOT_NAME …] [/NODE]", most=1001
    ),
    "flip-tools-from-hub": Script(Action.FLIP, _used_at_hub, "[ROBOTS | ROBOT_NAME …]", most=1000),
    "flip-for-ros2": Script(Action.FLIP, _through_ros2_door, "[ROBOTS | ROBOT_NAME …]", most=1000),
    "flip-from-remote": Script(
        Action.FLIP, _of_robot, "[--pull] [ROBOT_NAME [LASER_TOPIC]]", most=2
    ),
    "pioneer-nav-flip": Script(
        Action.FLIP, _of_robot, "[--pull] [ROBOT_NAME [LASER_TOPIC]]", most=2
    ),
    "flip-traffic": Script(Action.FLIP, lambda _: rule_set.flipped_for_traffic()),
    "flip-lockstep": Script(Action.FLIP, _token_of_robot, "[ROBOT_NAME]", most=1),
    "advertise_hub_publisher.py": Script(Action.ADVERTISE, _publisher, "topic", 1, 1),
    "pull_hub_publisher.py": Script(
        Action.PULL, partial(_publisher, gateway=rule_set.HUB_GATEWAY), "topic", 1, 1
    ),
    "flip_hub_subscriber.py": Script(
        Action.FLIP, partial(_flipped_at_hub, kind="subscriber"), _AT_HUB, 2, 4
    ),
    "flip_hub_publisher.py": Script(
        Action.FLIP, partial(_flipped_at_hub, kind="publisher"), _AT_HUB, 2, 4
    ),
    "flip_remote_subscriber.py": Script(
        Action.FLIP, partial(_flipped_at_robot, kind="subscriber"), _AT_ROBOT, 3, 3
    ),
    "flip_remote_publisher.py": Script(
        Action.FLIP, partial(_flipped_at_robot, kind="publisher"), _AT_ROBOT, 3, 3
    ),
}
_GENERIC: Mapping[str, tuple[Action, str]] = {
    "generic_advertiser.py": (Action.ADVERTISE, "publisher"),
    "generic_puller.py": (Action.PULL, "publisher"),
    "generic_flip_publisher.py": (Action.FLIP, "publisher"),
    "generic_flip_subscriber.py": (Action.FLIP, "subscriber"),
}
_SHARED: Mapping[str, tuple[Action, Callable[[], list[Wish]]]] = {
    "--pull": (Action.PULL, rule_set.pulled_from_hub),
    "--advertise": (Action.ADVERTISE, rule_set.advertised_by_hub),
}
"""Rules shared by all robots, requested before the script's own."""


def main() -> int:
    """Runs the script with this program's name."""
    return run(Path(sys.argv[0]).name)


def run(name: str) -> int:
    """Requests the rules for the command line of the script ``name``; with `--cancel` removes them."""
    if name in _GENERIC:
        return _generic(name, *_GENERIC[name])
    script = _SCRIPTS[name]
    arguments = rospy.myargv(sys.argv)[1:]
    cancel = "--cancel" in arguments
    options = [option for option in _SHARED if option in arguments and option in script.usage]
    asked = [(_SHARED[option][0], _SHARED[option][1]()) for option in options]
    arguments = [argument for argument in arguments if argument not in ("--cancel", *options)]
    if not script.least <= len(arguments) <= script.most or any(
        argument.startswith("-") for argument in arguments
    ):
        sys.stderr.write(" ".join(filter(None, ("Usage:", name, script.usage, "[--cancel]\n"))))
        return 0 if arguments in (["-h"], ["--help"]) else 2
    try:
        return _ask(name, [*asked, (script.action, script.wishes(arguments))], cancel)
    except RuleSetError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2


def _ask(name: str, asked: Sequence[tuple[Action, Sequence[Wish]]], cancel: bool) -> int:
    rospy.init_node(name.replace("-", "_").removesuffix(".py"), anonymous=True)
    try:
        client = GatewayClient()
        client.wait()
        # One call for all rules of an action: all or none are accepted.
        return 0 if all(client.ask(action, wishes, cancel) for action, wishes in asked) else 1
    except rospy.ROSException:
        return 130


def _generic(name: str, action: Action, kind: str) -> int:
    """Requests one rule given by options. A topic has the same name on both sides, so the namespaces must be equal."""
    parser = argparse.ArgumentParser(name, description=f"{action} one {kind}")
    parser.add_argument(
        "-g", "--gateway", default="", help="the other gateway", required=action != Action.ADVERTISE
    )
    parser.add_argument(
        "-t", "--topic", required=True, help="the topic; with a leading slash as it stands"
    )
    parser.add_argument("-n", "--node", default="", help="the node; any if left out")
    parser.add_argument(
        "-r", "--remote_namespace", default="", help="namespace of the topic at the other gateway"
    )
    parser.add_argument("-l", "--local_namespace", default="", help="namespace of the topic here")
    parser.add_argument("--cancel", action="store_true", help="take the rule back")
    options = parser.parse_args(rospy.myargv(sys.argv)[1:])
    namespaces = {
        one.strip("/")
        for one in (options.remote_namespace, options.local_namespace)
        if one.strip("/")
    }
    if len(namespaces) > 1:
        parser.error("a topic has one name on both sides: give one namespace")
    topic = rule_set.topic_in(next(iter(namespaces), ""), options.topic)
    gateway = "" if action == Action.ADVERTISE else options.gateway
    return _ask(
        name,
        [(action, [Wish(kind, topic, rule_set.node_named(options.node), gateway)])],
        options.cancel,
    )
