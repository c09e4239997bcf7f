"""``fleet_page``: web dashboard of the fleet, a node on Hub_Gateway's master."""

import dataclasses
import os
import secrets
import threading
from collections.abc import Sequence
from pathlib import Path

import rosgraph
import rospkg
import rospy
from rosgraph.names import is_legal_base_name

from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.state import ACTIONS
from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes.entry import is_ending, on_shutdown, parameters, run, wait
from pioneer_web.access.access_control import Access, Role
from pioneer_web.command.commander import Commander
from pioneer_web.command.recording import Recording
from pioneer_web.page.server import Server
from pioneer_web.state.feed import Feed
from pioneer_web.state.robot import Robot
from pioneer_web.state.station import Station
from rocon_flip.gateway_client import GatewayClient
from rocon_flip.rule_set import Action, Wish, flipped_from_hub, topic_in

NAME = "fleet_page"
TOKENS = {Role.OPERATOR: "PIONEER_WEB_TOKEN", Role.VIEWER: "PIONEER_WEB_VIEWER_TOKEN"}
"""Environment variables with the login tokens; if unset, random tokens are generated and printed."""
SHORTEST = 16
"""Minimum length of a token [characters]."""
ROBOT_NAMES = "/robot_names"
"""Parameter with the names of the fleet's robots, in the order of their computers; joining robots are appended."""
LOOPBACK = ("127.0.0.1", "localhost", "::1")
_SEEN = (
    "map_goal_client/queue",
    f"({'|'.join(ACTIONS)})/state",  # one rule: a fleet without right of way lacks one of the topics
    "amcl_pose",
    "computer",
    "rosout_agg",
)
_SENT = ("map_goal_pose", "initialpose", "map_goal_client/cancel", "move_base/cancel")


@dataclasses.dataclass(frozen=True)
class PageConfig:
    """Parameters of the node."""

    host: str = "127.0.0.1"  #: address to listen on; TLS is required unless it is the loopback
    port: int = 8090  #: TCP port
    session_hours: float = 12.0  #: session lifetime, after which users must log in again [h]
    tls_directory: str = (
        ""  #: folder of the machine's ``tls.crt`` and ``tls.key``, see ``make_certificates``
    )
    insecure: bool = False  #: allows other addresses without TLS
    masters: str = ""  #: masters to record, "NAME=URI …"; empty for this node's master only
    recordings: str = "~/.ros/recordings"  #: folder for recordings

    def __post_init__(self) -> None:
        if not 0 < self.port < 65536:
            raise ParameterError(f"~port must be 1 to 65535, not {self.port}")
        if not 0 < self.session_hours <= 720:
            raise ParameterError(
                f"~session_hours must be more than 0, at most 720, not {self.session_hours:g}"
            )
        if self.host not in LOOPBACK and not self.tls_directory and not self.insecure:
            raise ParameterError(
                f"~host {self.host} is reachable from other machines: give ~tls_directory, or ~insecure:=true where "
                "nobody else reads the network"
            )


class FleetPageNode:
    """Serves the dashboard.

    Subscribes, publishes, calls: see `Feed`, `Commander` and `Foxglove`; requests flips to and from this node from the
    gateway. Parameters: `PageConfig`; /robot_names (waits for it and follows changes). Environment: ``TOKENS``.
    Threads: the main thread serves; one thread calls the gateway; rospy's.
    On error: the node ends if the port is in use.
    """

    def __init__(self) -> None:
        self._config = config_from_mapping(PageConfig, parameters(), rospy.get_name())
        self._tokens = {role: _token(name) for role, name in TOKENS.items()}
        self._access = Access(self._tokens, 3600 * self._config.session_hours)

    def spin(self) -> None:
        """Waits for the fleet, then serves until shutdown."""
        _await_robots()
        if is_ending():
            return
        masters = self._config.masters or f"base={rosgraph.get_master_uri()}"
        recording = Recording(Path(self._config.recordings).expanduser(), masters.split())
        on_shutdown(recording.close)

        def refusal(start: Pose | None, goal: Pose) -> str:
            return feed.reach.refusal(start, goal) if feed.reach else ""

        commander = Commander(recording, refusal)
        feed = Feed(Station(), commander.on_queue)

        def take_in() -> None:
            names = _robot_names()
            known = {robot.name for robot in feed.station.robots}
            robots = [
                Robot(name=name, gateway=f"aadi{number}_gateway")
                for number, name in enumerate(names, 1)
            ]
            if new := [robot for robot in robots if robot.name not in known]:
                commander.add(new)
                feed.add(new)
                threading.Thread(
                    target=_ask_for_flips, args=(names, new), name="flips", daemon=True
                ).start()

        take_in()
        config, static = self._config, Path(rospkg.RosPack().get_path("pioneer_web")) / "static"
        folder = Path(config.tls_directory).expanduser()
        files = (folder / "tls.crt", folder / "tls.key") if config.tls_directory else (None, None)
        server = Server(
            feed, commander, self._access, take_in, static, config.host, config.port, *files
        )
        on_shutdown(server.end)
        scheme = "https" if config.tls_directory else "http"
        for role, what in ((Role.OPERATOR, "to drive"), (Role.VIEWER, "only to look")):
            if TOKENS[role] not in os.environ:
                rospy.loginfo(
                    "fleet page, %s: %s://%s:%d/#%s",
                    what,
                    scheme,
                    config.host,
                    config.port,
                    self._tokens[role],
                )
        server.run()


def _token(variable: str) -> str:
    token = os.environ.get(variable) or secrets.token_urlsafe(SHORTEST)
    if len(token) < SHORTEST:
        raise ParameterError(f"{variable} must have {SHORTEST} characters at least")
    return token


def _await_robots() -> None:
    """Waits until step 3 has set the robots' names."""
    while not rospy.has_param(ROBOT_NAMES):
        if wait(0.2):
            return


def _robot_names() -> list[str]:
    """Returns the robots' names from the cached parameter; empty if it is not a list of valid names."""
    names = rospy.get_param_cached(ROBOT_NAMES, [])
    is_sound = isinstance(names, list) and all(
        isinstance(name, str) and is_legal_base_name(name) for name in names
    )
    return names if is_sound else []


def _ask_for_flips(names: Sequence[str], new: Sequence[Robot]) -> None:
    """Requests flips of the topics that pages show of, or send to, new robots; no traffic until this node subscribes.

    ``names`` lists all robots in the order of their computers.
    """
    # A pattern, as for RViz's tools: it does not wait for a node, so computers count as ready without the page.
    node, client = f"/{NAME}.*", GatewayClient()
    gateways = {robot.gateway for robot in new}
    wishes = [wish for wish in flipped_from_hub(names) if wish.gateway in gateways]
    for robot in new:
        wishes += [
            Wish("subscriber", topic_in(robot.name, topic), node, robot.gateway) for topic in _SEEN
        ]
        wishes += [
            Wish("publisher", topic_in(robot.name, topic), node, robot.gateway) for topic in _SENT
        ]
    try:
        client.wait()
        client.ask(Action.FLIP, wishes)
    except rospy.ROSException:
        return  # the node is shutting down


def main() -> int:
    """Runs the node; returns its exit status."""
    return run(NAME, FleetPageNode, wall_time=True)
