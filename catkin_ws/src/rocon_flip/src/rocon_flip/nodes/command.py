"""What the scripts of this package do; each is a function that takes the command line and returns an exit status."""

import argparse
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence

import rospy

from rocon_flip.core import plan
from rocon_flip.core.plan import Action, PlanError, Wish
from rocon_flip.nodes.gateway_client import GatewayClient

Wishes = Callable[[list[str]], list[Wish]]
_SHARED: Mapping[str, tuple[Action, Callable[[], list[Wish]]]] = {
    "--pull": (Action.PULL, plan.pulled_from_hub),
    "--advertise": (Action.ADVERTISE, plan.advertised_by_hub),
}


def _run(name: str, usage: str, action: Action, wishes: Wishes, least: int = 0, most: int = 0) -> int:
    """Asks for the rules that follow from the command line; with `--cancel` takes them back.

    Where ``usage`` has them, `--pull` first pulls what all robots share and `--advertise` advertises it.
    """
    arguments = rospy.myargv(sys.argv)[1:]
    cancel = "--cancel" in arguments
    options = [option for option in _SHARED if option in arguments and option in usage]
    asked = [(_SHARED[option][0], _SHARED[option][1]()) for option in options]
    arguments = [argument for argument in arguments if argument not in ("--cancel", *options)]
    if not least <= len(arguments) <= most or any(argument.startswith("-") for argument in arguments):
        sys.stderr.write(f"Usage: {usage} [--cancel]\n")
        return 0 if arguments in (["-h"], ["--help"]) else 2
    try:
        return _ask(name, [*asked, (action, wishes(arguments))], cancel)
    except PlanError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2


def _ask(name: str, asked: Sequence[tuple[Action, Sequence[Wish]]], cancel: bool) -> int:
    rospy.init_node(name.replace("-", "_").removesuffix(".py"), anonymous=True)
    try:
        client = GatewayClient()
        client.wait()
        # One call for all of an action, whichever way they go: all of them or none.
        return 0 if all(client.ask(action, wishes, cancel) for action, wishes in asked) else 1
    except rospy.ROSException:
        return 130


def advertise_from_hub() -> int:
    """`advertise-from-hub`: the topics that all robots share."""
    name = "advertise-from-hub"
    return _run(name, name, Action.ADVERTISE, lambda _: plan.advertised_by_hub())


def pull_from_hub() -> int:
    """`pull-from-hub`: the same, on a robot."""
    name = "pull-from-hub"
    return _run(name, name, Action.PULL, lambda _: plan.pulled_from_hub())


def flip_from_hub() -> int:
    """`flip-from-hub [ROBOTS | ROBOT_NAME …] [/NODE]`: what RViz on the hub shows, for any node or one."""
    name = "flip-from-hub"

    def wishes(arguments: list[str]) -> list[Wish]:
        nodes = [one for one in arguments if one.startswith("/")]
        robots = [one for one in arguments if one not in nodes]
        return plan.flipped_from_hub(plan.robot_names(robots, os.environ), *nodes[:1])

    return _run(name, f"{name} [--advertise] [ROBOTS | ROBOT_NAME …] [/NODE]", Action.FLIP, wishes, most=1001)


def flip_tools_from_hub() -> int:
    """`flip-tools-from-hub [ROBOTS | ROBOT_NAME …]`: goals and initial poses that are set in RViz on the hub."""
    name = "flip-tools-from-hub"

    def wishes(arguments: list[str]) -> list[Wish]:
        return plan.flipped_by_tools(plan.robot_names(arguments, os.environ))

    return _run(name, f"{name} [ROBOTS | ROBOT_NAME …]", Action.FLIP, wishes, most=1000)


def flip_from_remote() -> int:
    """`flip-from-remote [ROBOT_NAME [LASER_TOPIC]]`, also called `pioneer-nav-flip`: a robot's sensors and commands."""
    name = "flip-from-remote"

    def wishes(arguments: list[str]) -> list[Wish]:
        robot = plan.robot_name(arguments, os.environ, socket.gethostname())
        return plan.flipped_from_robot(robot, *arguments[1:])

    return _run(name, f"{name} [--pull] [ROBOT_NAME [LASER_TOPIC]]", Action.FLIP, wishes, most=2)


def flip_traffic() -> int:
    """`flip-traffic`: a robot's reports on the right of way, to all other robots."""
    name = "flip-traffic"
    return _run(name, name, Action.FLIP, lambda _: plan.flipped_for_traffic())


def advertise_hub_publisher() -> int:
    """`advertise_hub_publisher.py TOPIC`."""
    name = "advertise_hub_publisher.py"
    usage = f"{name} topic"
    return _run(name, usage, Action.ADVERTISE, lambda a: [Wish("publisher", plan.topic_in("", a[0]))], 1, 1)


def pull_hub_publisher() -> int:
    """`pull_hub_publisher.py TOPIC`."""
    name = "pull_hub_publisher.py"

    def wishes(arguments: list[str]) -> list[Wish]:
        return [Wish("publisher", plan.topic_in("", arguments[0]), gateway=plan.HUB_GATEWAY)]

    return _run(name, f"{name} topic", Action.PULL, wishes, 1, 1)


def _flip_one(name: str, kind: str, from_hub: bool) -> int:
    """A single flip: the hub's scripts name the robot's host (`aadi1`), a robot's always mean the hub.

    With two arguments at the hub they are topic and gateway, as the published repository's scripts have it.
    """

    def wishes(arguments: list[str]) -> list[Wish]:
        if len(arguments) == 2:
            return [plan.flipped_topic(kind, *arguments)]
        if from_hub and len(arguments) == 3:
            raise PlanError(f"3 arguments are ambiguous; usage: {usage}")
        namespace, topic, node = arguments[:3]
        gateway = f"{arguments[3]}_gateway" if from_hub else plan.HUB_GATEWAY
        return [Wish(kind, plan.topic_in(namespace, topic), plan.node_named(node), gateway)]

    usage = f"{name} namespace topic node{f' gate | {name} topic gateway' if from_hub else ''}"
    return _run(name, usage, Action.FLIP, wishes, *((2, 4) if from_hub else (3, 3)))


def flip_hub_subscriber() -> int:
    """`flip_hub_subscriber.py NAMESPACE TOPIC NODE GATE`."""
    return _flip_one("flip_hub_subscriber.py", "subscriber", from_hub=True)


def flip_hub_publisher() -> int:
    """`flip_hub_publisher.py NAMESPACE TOPIC NODE GATE`."""
    return _flip_one("flip_hub_publisher.py", "publisher", from_hub=True)


def flip_remote_subscriber() -> int:
    """`flip_remote_subscriber.py NAMESPACE TOPIC NODE`."""
    return _flip_one("flip_remote_subscriber.py", "subscriber", from_hub=False)


def flip_remote_publisher() -> int:
    """`flip_remote_publisher.py NAMESPACE TOPIC NODE`."""
    return _flip_one("flip_remote_publisher.py", "publisher", from_hub=False)


def _generic(name: str, action: Action, kind: str) -> int:
    """One rule from options. Names are the same on both sides, so the two namespaces cannot differ for a topic."""
    parser = argparse.ArgumentParser(name, description=f"{action} one {kind}")
    parser.add_argument("-g", "--gateway", default="", help="the other gateway", required=action != Action.ADVERTISE)
    parser.add_argument("-t", "--topic", required=True, help="the topic; with a leading slash as it stands")
    parser.add_argument("-n", "--node", default="", help="the node; any if left out")
    parser.add_argument("-r", "--remote_namespace", default="", help="namespace of the topic at the other gateway")
    parser.add_argument("-l", "--local_namespace", default="", help="namespace of the topic here")
    parser.add_argument("--cancel", action="store_true", help="take the rule back")
    options = parser.parse_args(rospy.myargv(sys.argv)[1:])
    namespaces = {one.strip("/") for one in (options.remote_namespace, options.local_namespace) if one.strip("/")}
    if len(namespaces) > 1:
        parser.error("a topic has one name on both sides: give one namespace")
    topic = plan.topic_in(next(iter(namespaces), ""), options.topic)
    gateway = "" if action == Action.ADVERTISE else options.gateway
    return _ask(name, [(action, [Wish(kind, topic, plan.node_named(options.node), gateway)])], options.cancel)


def generic_advertiser() -> int:
    """`generic_advertiser.py -t topic [-n node] [-l local_namespace]`."""
    return _generic("generic_advertiser.py", Action.ADVERTISE, "publisher")


def generic_puller() -> int:
    """`generic_puller.py -g gateway -t topic [-n node] [-r remote_namespace]`."""
    return _generic("generic_puller.py", Action.PULL, "publisher")


def generic_flip_publisher() -> int:
    """`generic_flip_publisher.py -g gateway -t topic [-n node] [-l local_namespace]`."""
    return _generic("generic_flip_publisher.py", Action.FLIP, "publisher")


def generic_flip_subscriber() -> int:
    """`generic_flip_subscriber.py -g gateway -t topic [-n node] [-r remote_namespace]`."""
    return _generic("generic_flip_subscriber.py", Action.FLIP, "subscriber")
