"""Rules between real gateways: their effect, timing and order, and which requests are refused."""

import os
import signal
import time

import pytest
from gateway_msgs import msg, srv

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def test_flips_and_pulls_bring_messages_at_once_and_cancelling_ends_them(pair, report) -> None:
    base, robot = pair
    robot.talk("/p1/scan")
    base.talk("/clock2")
    scan, clock = base.hear("/p1/scan"), robot.hear("/clock2", "clock_listener")

    asked = time.monotonic()
    assert base.flip("robot", "subscriber", "/p1/scan") == 0
    flipped = scan.first_after(asked)
    assert base.advertise("/clock2").result == 0
    asked = time.monotonic()
    assert robot.pull("base", "publisher", "/clock2") == 0
    pulled = clock.first_after(asked)
    report("flip", flipped)
    report("pull", pulled)
    assert max(flipped, pulled) < 1.0
    assert robot.publishers("/clock2") == ["/base/talker"]
    wait_until(
        lambda: base.states() == {"flip /p1/scan": "active", "advertise /clock2": "active"},
        "both active",
        5,
    )

    assert base.flip("robot", "subscriber", "/p1/scan") == msg.ErrorCodes.FLIP_RULE_ALREADY_EXISTS
    assert robot.pull("base", "publisher", "/clock2") == msg.ErrorCodes.PULL_RULE_ALREADY_EXISTS
    assert base.advertise("/new", "/clock2").result == msg.ErrorCodes.ADVERTISEMENT_EXISTS
    assert [rule.name for rule in base.info().public_watchlist] == ["/clock2"]

    assert base.flip("robot", "subscriber", "/p1/scan", cancel=True) == 0
    asked = time.monotonic()
    wait_until(lambda: base.publishers("/p1/scan") == [], "the proxy is gone", 2)
    wait_until(lambda: time.monotonic() - scan.times()[-1] > 0.5, "silence", 3)
    assert scan.times()[-1] - asked < 1.0
    assert clock.first_after(time.monotonic()) < 1.0


def test_a_flipped_publisher_goes_the_other_way_and_only_the_named_node_hears(pair) -> None:
    base, robot = pair
    wanted, other = base.hear("/cmd", "wanted"), base.hear("/cmd", "other")
    robot.talk("/cmd")
    asked = time.monotonic()
    assert base.flip("robot", "subscriber", "/cmd", "/wanted") == 0
    wanted.first_after(asked)
    assert other.times() == []
    assert robot.flip("base", "publisher", "/cmd") == 0
    other.first_after(asked)
    wait_until(
        lambda: [one.status for one in robot.info().flipped_connections] == ["accepted"],
        "accepted",
        5,
    )
    wait_until(
        lambda: [one.rule.name for one in base.info().flipped_in_connections] == ["/cmd"],
        "flipped in",
        5,
    )


def test_rules_may_come_before_gateways_topics_and_hub(fleet, report) -> None:
    base = fleet.site("base").start()
    assert base.flip("robot", "subscriber", "/late") == 0
    assert base.pull("robot", "publisher", "/late") == msg.ErrorCodes.NO_HUB_CONNECTION
    wait_until(
        lambda: base.states() == {"flip /late": "pending: waiting for a hub"}, "the rule's state", 5
    )
    ear = base.hear("/late")
    fleet.start_hub()
    base.connected()
    wait_until(
        lambda: base.states()["flip /late"].startswith("no such gateway"), "no such gateway", 5
    )
    robot = fleet.site("robot").start().connected()
    wait_until(lambda: base.states()["flip /late"].startswith("no such topic"), "no such topic", 5)
    robot.talk("/late")
    born = time.monotonic()
    report("new publisher", ear.first_after(born))
    wait_until(lambda: base.states() == {"flip /late": "active"}, "active", 5)


def test_a_pattern_never_brings_another_robots_topics_whoever_joins_first(
    fleet,
) -> None:
    fleet.start_hub()
    base = fleet.site("base").start(robot_namespaces="carol").connected()
    alice = fleet.site("alice_gateway").start(namespace="alice").connected()
    for name in ("alice", "bob", "carol"):
        base.talk(f"/{name}/odom", f"{name}_source")
    assert base.call("advertise_all", srv.AdvertiseAll, cancel=False).result == 0
    assert alice.pull("base", "publisher", ".*/odom") == 0
    wait_until(
        lambda: alice.publishers("/alice/odom") and alice.publishers("/bob/odom"),
        "what it may have",
        10,
    )
    assert alice.publishers("/carol/odom") == [], "the base station has told of carol"
    bob = fleet.site("bob_gateway").start(namespace="bob").connected()
    wait_until(lambda: alice.publishers("/bob/odom") == [], "bob is a robot now", 5)
    assert alice.publishers("/alice/odom") == ["/base/alice_source"]
    bob.stop()
    assert alice.pull("base", "publisher", "/bob/odom") == 0
    wait_until(lambda: alice.publishers("/bob/odom"), "what spells it out", 5)
    wait_until(lambda: alice.states()["pull .*/odom"] == "active", "active", 5)


def test_bad_requests_are_refused_and_everything_continues(pair) -> None:
    base, robot = pair
    codes = msg.ErrorCodes
    bad = base.remote("flip", "robot", "publisher", "/a(")
    assert (bad.result, "not a regular expression" in bad.error_message) == (
        codes.HUB_UNKNOWN_ERROR,
        True,
    )
    assert base.flip("robot", "topic", "/a") == codes.HUB_UNKNOWN_ERROR
    for gateway in (" ", "ro\nbot", "robot\0", "robot("):
        refused = base.call("flip_all", srv.RemoteAll, gateway=gateway)
        assert (refused.result, "gateway" in refused.error_message) == (
            codes.HUB_UNKNOWN_ERROR,
            True,
        )
        assert refused.error_message.isprintable()
    assert base.flip("base", "publisher", "/a") == codes.REMOTE_GATEWAY_SELF_IS_NOT
    assert base.pull("base", "publisher", "/a") == codes.REMOTE_GATEWAY_SELF_IS_NOT
    assert base.advertise("/a", "/b", "/c").result == 0
    remaining = base.advertise("/a", cancel=True)
    assert (remaining.result, [rule.name for rule in remaining.watchlist]) == (0, ["/b", "/c"])
    assert base.advertise("/a", cancel=True).result == codes.ADVERTISEMENT_NOT_FOUND
    assert base.flip("robot", "publisher", ".*") == 0
    assert base.call("flip_all", srv.RemoteAll, gateway="robot").result == 0
    assert (
        base.call("flip_all", srv.RemoteAll, gateway="robot").result
        == codes.FLIP_RULE_ALREADY_EXISTS
    )
    assert base.call("connect_hub", srv.ConnectHub, uri="nonsense without scheme").result == 12
    assert base.call("connect_hub", srv.ConnectHub, uri=base.info().hub_uris[0]).result == 11
    base.talk("/b")
    wait_until(lambda: robot.publishers("/b") == ["/base/talker"], "/b at robot", 5)
    assert not any(node.startswith("/base/gateway") for node in robot.publishers("/rosout"))
    (described,) = base.call("remote_gateway_info", srv.RemoteGatewayInfo).gateways
    assert (described.name, described.conn_stats.gateway_available) == ("robot", True)


def test_a_killed_gateway_is_noticed_and_a_new_one_takes_its_place(pair, report) -> None:
    base, robot = pair
    robot.talk("/a")
    ear = base.hear("/a")
    base.flip("robot", "subscriber", "/a")
    ear.first_after(0.0)
    os.kill(robot.pid, signal.SIGKILL)
    died = time.monotonic()
    wait_until(
        lambda: base.publishers("/a") == [] and base.states()["flip /a"] != "active", "noticed", 6
    )
    report("killed gateway noticed", time.monotonic() - died)
    back = time.monotonic()
    robot.start()
    ear.first_after(back)


def test_a_killed_hub_stops_no_data_and_its_return_restores_everything(fleet, pair, report) -> None:
    base, robot = pair
    robot.talk("/a")
    ear = base.hear("/a")
    base.flip("robot", "subscriber", "/a")
    ear.first_after(0.0)
    (hub,) = [pid for pid in fleet.group.states() if _is_hub(pid)]
    os.kill(hub, signal.SIGKILL)
    wait_until(lambda: not base.info().connected and not robot.info().connected, "hub lost", 5)
    ear.first_after(time.monotonic())
    assert base.flip("robot", "subscriber", "/b") == 0
    fleet.start_hub()
    base.connected()
    robot.connected()
    back = time.monotonic()
    wait_until(lambda: base.states()["flip /a"] == "active", "active again", 5)
    wait_until(
        lambda: base.states()["flip /b"].startswith("no such topic"), "the new rule is answered", 5
    )
    report("rules answered after the hub's return", time.monotonic() - back)
    gaps = [late - early for early, late in zip(ear.times(), ear.times()[1:], strict=False)]
    assert max(gaps) < 1.5


def test_shutting_down_in_any_order_leaves_nothing_behind(pair, report) -> None:
    base, robot = pair
    robot.talk("/a")
    base.flip("robot", "subscriber", "/a")
    robot.flip("base", "publisher", "/a")
    wait_until(lambda: base.publishers("/a") == ["/robot/talker"], "the proxy", 5)
    os.kill(robot.pid, signal.SIGINT)
    left = time.monotonic()
    wait_until(lambda: base.publishers("/a") == [], "the proxy is gone", 5)
    report("clean leave noticed", time.monotonic() - left)
    wait_until(lambda: robot.publishers("/gateway/gateway_info") == [], "robot's gateway gone", 5)
    subscribers = robot.master.system_state
    wait_until(
        lambda: all("/gateway" not in nodes for nodes in subscribers()[1].values()),
        "nothing of it",
        5,
    )


def _is_hub(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            return b"rocon_hub/hub" in file.read()
    except OSError:
        return False


def test_a_rule_with_a_rate_reports_it_and_keeps_to_it(fleet) -> None:
    fleet.start_hub()
    options = [{"name": "/p1/scan", "gateway": "base", "rate": 5}]
    robot = fleet.site("robot").start(rule_options=options).connected()
    base = fleet.site("base").start().connected()
    robot.talk("/p1/scan")
    scan = base.hear("/p1/scan")
    begin = time.monotonic()
    assert base.flip("robot", "subscriber", "/p1/scan") == 0
    said = "rate-limited: at most 5 messages a second"
    wait_until(lambda: base.states() == {"flip /p1/scan": said}, "the state", 5)
    wait_until(lambda: len(scan.times()) > 8, "messages", 10)
    assert len(scan.times()) <= 5 * (time.monotonic() - begin) + 1
    for site in (base, robot):
        wait_until(
            lambda site=site: _latency(site) > 0, f"{site.name} knows how long the way takes", 15
        )


def _latency(site) -> float:
    return (
        site.call("remote_gateway_info", srv.RemoteGatewayInfo)
        .gateways[0]
        .conn_stats.ping_latency_avg
    )
