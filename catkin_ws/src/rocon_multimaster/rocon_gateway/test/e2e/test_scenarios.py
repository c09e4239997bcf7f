"""The checks of rocon's own tests: one connection of each kind on one gateway, every kind of request, and the result.

One hub, two gateways and five nodes serve all tests of this file.
"""

import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from gateway_msgs import msg, srv

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

NODES = Path(__file__).parent.parent / "node"
RELAY_NODES = NODES.parents[2] / "rocon_relay/test/node"
BLACKLIST = Path(__file__).parent.parent.parent / "config" / "default_blacklist.yaml"

FIVE = {
    ("publisher", "/chatter", "/talker"),
    ("subscriber", "/chatter", "/listener"),
    ("service", "/add_two_ints", "/add_two_ints_server"),
    ("action_server", "/fibonacci/server", "/fibonacci_server"),
    ("action_client", "/fibonacci/client", "/fibonacci_client"),
}
PLAIN = [msg.Rule(kind, name, node) for kind, name, node in sorted(FIVE)]
PATTERNS = [msg.Rule(kind, f"{name[:-3]}.*", f".*{node[3:]}") for kind, name, node in sorted(FIVE)]
ACCEPTED_WITHIN, GONE_WITHIN, UNADVERTISED_WITHIN = 5, 2, 10
LATE_FLIP = {"gateway": "late", "rule": {"type": "publisher", "name": "/nothing", "node": ""}}


@pytest.fixture(scope="module")
def sites(shared_fleet) -> tuple[Any, Any]:
    """`base`, which runs the five nodes, and `robot`, which flips to a gateway that joins late."""
    shared_fleet.start_hub()
    base, robot = shared_fleet.site("base"), shared_fleet.site("robot")
    rules = yaml.safe_load(BLACKLIST.read_text())
    base.start(**rules)
    robot.start(default_flips=[LATE_FLIP], **rules)
    cast(shared_fleet, base)
    wait_until(lambda: five_are_up(base), "the five nodes", 60)
    return base.connected(), robot.connected()


def cast(fleet, site) -> None:
    probe = Path(__file__).with_name("probe.py")
    for name, *argv in (
        ("talker", probe, "talk", "talker", "/chatter"),
        ("listener", probe, "hear", "listener", "/chatter"),
        ("add_two_ints_server", RELAY_NODES / "server.py", "/echo:=/add_two_ints"),
        ("fibonacci_server", NODES / "action.py", "serve", "/fibonacci/server"),
        ("fibonacci_client", NODES / "action.py", "idle", "/fibonacci/client"),
    ):
        command = [sys.executable, *map(str, argv), f"__name:={name}"]
        fleet.group.start(name, command, site.master.environment, fleet.folder / f"{name}.log")


def five_are_up(site) -> bool:
    publishers, subscribers, services = site.master.system_state()
    topics = {"/chatter", "/fibonacci/server/result", "/fibonacci/client/cancel"}
    heard = {"/chatter", "/fibonacci/server/cancel", "/fibonacci/client/status"}
    return (
        topics <= publishers.keys() and heard <= subscribers.keys() and "/add_two_ints" in services
    )


def rows(rules: list[Any]) -> set[tuple[str, str, str]]:
    found = [(rule.type, rule.name, rule.node) for rule in rules]
    assert len(found) == len(set(found)), "nothing is listed twice"
    return set(found)


def advertised(site) -> set[tuple[str, str, str]]:
    return rows(site.info().public_interface)


def accepted(site) -> set[tuple[str, str, str]]:
    flipped = site.info().flipped_connections
    assert all(one.remote_rule.gateway == "robot" for one in flipped)
    return rows(
        [one.remote_rule.rule for one in flipped if one.status == msg.RemoteRuleWithStatus.ACCEPTED]
    )


def pulled(site) -> set[tuple[str, str, str]]:
    return rows([one.rule for one in site.info().pulled_connections])


def to(gateway: str, rules: list[Any]) -> list[Any]:
    return [msg.RemoteRule(gateway, rule) for rule in rules]


def advertise_all(base, cancel: bool) -> int:
    return int(base.call("advertise_all", srv.AdvertiseAll, cancel=cancel).result)


def all_of(action: str, gateway: str) -> Callable[[Any, bool], int]:
    return lambda site, cancel: int(
        site.call(
            f"{action}_all", srv.RemoteAll, gateway=gateway, blacklist=[], cancel=cancel
        ).result
    )


def singly(action: str, gateway: str, rules: list[Any]) -> Callable[[Any, bool], int]:
    return lambda site, cancel: max(
        int(site.call(action, srv.Remote, remotes=[one], cancel=cancel).result)
        for one in to(gateway, rules)
    )


def at_once(action: str, gateway: str, rules: list[Any]) -> Callable[[Any, bool], int]:
    return lambda site, cancel: int(
        site.call(action, srv.Remote, remotes=to(gateway, rules), cancel=cancel).result
    )


def advertise(rules: list[Any]) -> Callable[[Any, bool], int]:
    return lambda site, cancel: max(
        int(site.call("advertise", srv.Advertise, rules=[rule], cancel=cancel).result)
        for rule in rules
    )


@pytest.mark.parametrize(
    "ask",
    [advertise_all, advertise(PLAIN), advertise(PATTERNS)],
    ids=["all", "five single", "five patterns"],
)
def test_advertising_shows_exactly_the_five(sites, ask) -> None:
    base, _ = sites
    assert ask(base, False) == 0
    wait_until(lambda: advertised(base) == FIVE, "five advertised", ACCEPTED_WITHIN)
    assert ask(base, True) == 0
    wait_until(lambda: not advertised(base), "none advertised", UNADVERTISED_WITHIN)


@pytest.mark.parametrize(
    "ask",
    [all_of("flip", "robot"), at_once("flip", "robot", PLAIN), at_once("flip", "robot", PATTERNS)],
    ids=["all", "five in one call", "patterns"],
)
def test_flips_show_exactly_the_five_accepted(sites, ask) -> None:
    base, robot = sites
    assert ask(base, False) == 0
    wait_until(lambda: accepted(base) == FIVE, "five accepted", ACCEPTED_WITHIN)
    wait_until(lambda: robot.publishers("/chatter") == ["/base/talker"], "the proxy", 5)
    assert ask(base, True) == 0
    wait_until(lambda: not base.info().flipped_connections, "none flipped", GONE_WITHIN)
    wait_until(lambda: not robot.info().flipped_in_connections, "none flipped in", GONE_WITHIN)


@pytest.mark.parametrize(
    "ask",
    [all_of("pull", "base"), singly("pull", "base", PLAIN), singly("pull", "base", PATTERNS)],
    ids=["all", "five", "five patterns"],
)
def test_pulls_show_exactly_the_five(sites, ask) -> None:
    base, robot = sites
    assert advertise_all(base, False) == 0
    assert ask(robot, False) == 0
    wait_until(lambda: pulled(robot) == FIVE, "five pulled", ACCEPTED_WITHIN)
    assert ask(robot, True) == 0
    wait_until(lambda: not pulled(robot), "none pulled", GONE_WITHIN)
    assert advertise_all(base, True) == 0


def test_what_was_flipped_here_is_not_advertised_here(sites) -> None:
    base, robot = sites
    flip_all = all_of("flip", "robot")
    assert flip_all(base, False) == 0
    wait_until(
        lambda: "/add_two_ints" in robot.master.system_state()[2],
        "the service at robot",
        ACCEPTED_WITHIN,
    )
    assert advertise_all(robot, False) == 0
    wait_until(lambda: robot.info().public_watchlist, "everything is advertised", 5)
    assert advertised(robot) == set()
    assert advertise_all(robot, True) == 0
    assert flip_all(base, True) == 0


def test_a_taken_service_name_is_blocked_until_its_server_is_gone(sites) -> None:
    base, robot = sites
    # Something listens at the local server's address: a dead one would not keep its name.
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"127.0.0.1:{listening.getsockname()[1]}"
        local = robot.master.proxy("/local")
        local.registerService("/add_two_ints", f"rosrpc://{address}", f"http://{address}/")
        assert base.flip("robot", "service", "/add_two_ints") == 0
        refused = "refused: /add_two_ints is served by /local here already"
        wait_until(lambda: base.states()["flip /add_two_ints"] == refused, "refused", 5)
        assert [one.status for one in base.info().flipped_connections] == ["blocked"]
        assert robot.master.system_state()[2]["/add_two_ints"] == ["/local"]
        local.unregisterService("/add_two_ints", f"rosrpc://{address}")
        wait_until(lambda: base.states()["flip /add_two_ints"] == "active", "active", 5)
        local.registerService("/add_two_ints", f"rosrpc://{address}", f"http://{address}/")
        wait_until(
            lambda: base.states()["flip /add_two_ints"] == refused,
            "a local server takes its name",
            5,
        )
        local.unregisterService("/add_two_ints", f"rosrpc://{address}")
        assert base.flip("robot", "service", "/add_two_ints", cancel=True) == 0
        wait_until(
            lambda: "/add_two_ints" not in robot.master.system_state()[2],
            "unregistered",
            GONE_WITHIN,
        )
        wait_until(lambda: not base.states()["flip /add_two_ints"], "the rule is gone", 5)


def run(site, *command: str) -> str:
    result = subprocess.run(
        command,
        env=site.master.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
    )
    return result.stdout


def test_a_flipped_service_is_known_to_the_tools_and_answers(sites) -> None:
    base, robot = sites
    assert base.flip("robot", "service", "/add_two_ints") == 0
    served = {"/add_two_ints": ["/base/add_two_ints_server"]}
    wait_until(
        lambda: served.items() <= robot.master.system_state()[2].items(), "the service at robot", 5
    )
    described = run(robot, "rosservice", "info", "/add_two_ints")
    assert "Node: /base/add_two_ints_server\n" in described
    assert "Type: gateway_msgs/ConnectHub" in described
    assert 'error_message: "2 + 3"' in run(robot, "rosservice", "call", "/add_two_ints", "2 + 3")
    assert "as you wish" in run(robot, "rosservice", "call", "/add_two_ints", "fail")
    assert base.flip("robot", "service", "/add_two_ints", cancel=True) == 0
    wait_until(
        lambda: "/add_two_ints" not in robot.master.system_state()[2], "unregistered", GONE_WITHIN
    )


SAMPLES = """
import sys, rospy
from rocon_gateway import GatewayError, GatewaySampleRuntimeError, Graph, samples
assert issubclass(GatewaySampleRuntimeError, GatewayError)
rospy.init_node("samples_test")
assert "already" in samples.connect_hub_by_service(raise_exception=False, uri=sys.argv[1])[1]
samples.advertise_tutorials()
samples.advertise_tutorials(cancel=True)
samples.flip_tutorials("robot", regex_patterns=True)
graph = Graph()
assert not graph._local_gateway.flip_watchlist
graph.update()
assert len(graph._local_gateway.flip_watchlist) == 5, graph._local_gateway
assert [one.name for one in graph._remote_gateways] == ["robot"]
samples.flip_tutorials("robot", regex_patterns=True, cancel=True)
samples.pull_all()
samples.pull_all(cancel=True)
try:
    samples.flip_all("base")
except GatewaySampleRuntimeError as error:
    print("refused:", error)
"""


def test_rocons_samples_can_be_imported_and_do_what_their_names_say(shared_fleet, sites) -> None:
    base, _ = sites
    assert "refused: flip_all with" in run(
        base, sys.executable, "-c", SAMPLES, shared_fleet.hub_uri
    )


def flipped(base, robot, cancel: bool) -> None:
    assert base.flip("robot", "action_server", "/fibonacci/server", cancel=cancel) == 0


def pulled_action(base, robot, cancel: bool) -> None:
    rules = [msg.Rule("action_server", "/fibonacci/server", "")]
    assert base.call("advertise", srv.Advertise, rules=rules, cancel=cancel).result == 0
    assert robot.pull("base", "action_server", "/fibonacci/server", cancel=cancel) == 0


@pytest.mark.parametrize("connect", [flipped, pulled_action])
def test_a_whole_action_works_across(sites, connect) -> None:
    base, robot = sites
    connect(base, robot, False)
    told = run(
        robot, sys.executable, str(NODES / "action.py"), "call", "/fibonacci/server"
    ).splitlines()
    assert told == ["server True", "SUCCEEDED 5 [0, 1, 2, 3, 4]", "active True", "PREEMPTED"]
    connect(base, robot, True)
    wait_until(lambda: not robot.publishers("/fibonacci/server/status"), "gone", GONE_WITHIN)


def test_a_parameter_is_copied_by_its_name_only(sites) -> None:
    base, robot = sites
    base.master.set_param("/robot_description", "<robot/>")
    base.master.set_param("/secret", 1)
    rule = msg.Rule("parameter", "/robot_description", "")
    assert base.call("advertise", srv.Advertise, rules=[rule]).result == 0
    assert robot.pull("base", "parameter", "/robot_description") == 0
    assert robot.pull("base", "parameter", "/secret") == 0
    wait_until(lambda: robot.states()["pull /robot_description"].startswith("active"), "copied", 5)
    assert robot.master.get_param("/robot_description") == "<robot/>"
    wait_until(
        lambda: robot.states()["pull /secret"].startswith("no such parameter"),
        "what nobody advertises",
        5,
    )
    assert base.flip("robot", "parameter", "/secret") == msg.ErrorCodes.HUB_UNKNOWN_ERROR
    assert base.call("advertise", srv.Advertise, rules=[rule], cancel=True).result == 0


def test_a_default_flip_by_base_name_stands_before_and_after_its_gateway_comes(
    shared_fleet, sites
) -> None:
    _, robot = sites
    watched = [("late", "publisher", "/nothing", "")]
    assert flip_watchlist(robot) == watched
    assert robot.states()["flip /nothing"].startswith("no such gateway")
    late = shared_fleet.site("late").start(hub_uri="", disable_zeroconf=True, disable_uuids=False)
    assert not late.info().connected
    assert late.call("connect_hub", srv.ConnectHub, uri=shared_fleet.hub_uri).result == 0
    late.connected()
    wait_until(
        lambda: robot.states()["flip /nothing"].startswith("no such topic"), "the gateway is met", 5
    )
    assert flip_watchlist(robot) == watched


def flip_watchlist(site) -> list[tuple[str, str, str, str]]:
    return [
        (one.gateway, one.rule.type, one.rule.name, one.rule.node)
        for one in site.info().flip_watchlist
    ]
