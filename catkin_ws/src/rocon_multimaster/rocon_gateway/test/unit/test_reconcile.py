"""Gateways that exchange records and requests agree on the links; tested without hub, relay or master."""

import dataclasses

import pytest
from gateway_model import FakeGateway, Fleet, fleet_of, gateway, publisher, service, subscriber, to

from rocon_gateway.rules.matching import ALL
from rocon_gateway.rules.option_rule import option_rule
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.rulebook import RuleBook
from rocon_gateway.rules.situation import Outcome, Situation, State
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule
from rocon_relay.connection import LinkState
from rocon_relay.option import NO_OPTIONS, LinkOptions


def test_a_pull_brings_what_is_advertised() -> None:
    hub, robot = (
        gateway("hub", publisher("/clock", "/gazebo"), publisher("/secret")),
        gateway("robot"),
    )
    hub.book = hub.book.advertised([Rule(Kind.PUBLISHER, "/clock")])
    robot.book = robot.book.added("pull", [to("hub", Kind.PUBLISHER, ALL)])
    fleet_of(hub, robot)
    assert robot.imported() == {("/clock", "hub", "/gazebo")}
    assert robot.outcome.pulled[0].connection == publisher("/clock", "/gazebo")
    assert robot.states() == {f"pull {ALL}": "active"}
    assert hub.states() == {"advertise /clock": "active"}


def test_a_pulled_topic_may_come_later() -> None:
    hub, robot = gateway("hub"), gateway("robot")
    hub.book = hub.book.advertised([Rule(Kind.PUBLISHER, "/clock")])
    robot.book = robot.book.added("pull", [to("hub", Kind.PUBLISHER, "clock")])
    fleet = fleet_of(hub, robot)
    assert robot.states() == {"pull clock": State.NO_TOPIC}
    hub.local.add(publisher("/clock"))
    fleet.settle()
    assert robot.imported() == {("/clock", "hub", "/talker")}


def test_a_flipped_publisher_appears_at_the_other_gateway() -> None:
    hub, robot = (
        gateway("hub"),
        gateway("robot", publisher("/p1/cmd_vel", "/p1/controller"), publisher("/p1/scan")),
    )
    robot.book = robot.book.added("flip", [to("hub", Kind.PUBLISHER, "/p1/cmd_vel")])
    fleet_of(hub, robot)
    assert hub.imported() == {("/p1/cmd_vel", "robot", "/p1/controller")}
    assert robot.imported() == set()
    assert robot.outcome.flipped[0].status == "accepted"
    assert [one.gateway for one in hub.outcome.flipped_in] == ["robot"]
    assert robot.states() == {"flip /p1/cmd_vel": "active"}


def test_a_flipped_subscriber_brings_the_publishers_for_its_node_only() -> None:
    hub = gateway("hub", publisher("/p1/scan", "/gazebo"), publisher("/p1/scan", "/other"))
    robot = gateway("robot")
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/p1/scan", "/amcl.*")])
    fleet_of(hub, robot)
    assert robot.imported() == {("/p1/scan", "hub", "/gazebo"), ("/p1/scan", "hub", "/other")}
    assert {one.allowed_nodes for one in robot.outcome.imports} == {("/amcl.*",)}
    assert robot.states() == {"flip /p1/scan": "active"}


def test_two_rules_for_two_nodes_make_one_import_for_both() -> None:
    hub, robot = gateway("hub", publisher("/scan")), gateway("robot")
    robot.book = robot.book.added(
        "flip", [to("hub", Kind.SUBSCRIBER, "/scan", node) for node in ("/b", "/a")]
    )
    fleet_of(hub, robot)
    (only,) = robot.outcome.imports
    assert only.allowed_nodes == ("/a", "/b")
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/scan")])
    fleet_of(hub, robot)
    (only,) = robot.outcome.imports
    assert only.allowed_nodes == ()


def test_a_pattern_of_subscribers_means_subscribers_that_exist() -> None:
    hub = gateway("hub", publisher("/a"), publisher("/b"))
    robot = gateway("robot", subscriber("/a"))
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, ALL)])
    fleet_of(hub, robot)
    assert robot.imported() == {("/a", "hub", "/talker")}
    assert [one.connection for one in robot.outcome.flipped] == [subscriber("/a")]


def test_a_pulled_subscriber_gets_the_pullers_publishers() -> None:
    hub = gateway("hub", subscriber("/a", "/listener"), subscriber("/a", "/other"))
    robot = gateway("robot", publisher("/a"))
    hub.book = hub.book.advertised([Rule(Kind.SUBSCRIBER, "/a", "/listener")])
    robot.book = robot.book.added("pull", [to("hub", Kind.SUBSCRIBER, "/a")])
    fleet_of(hub, robot)
    (only,) = hub.outcome.imports
    assert (only.source_gateway, only.allowed_nodes) == ("robot", ("/listener",))
    assert robot.states() == {"pull /a": "active"}


def test_nobody_imports_what_nobody_asked_for() -> None:
    hub, robot = (
        gateway("hub", publisher("/a")),
        gateway("robot", publisher("/b"), subscriber("/a")),
    )
    fleet_of(hub, robot)
    assert hub.outcome.exports == robot.outcome.imports == frozenset()


def test_tf_crosses_both_ways_and_nothing_comes_back() -> None:
    hub = gateway("hub", publisher("/tf", "/gazebo"), subscriber("/tf", "/rviz"))
    robot = gateway("robot", publisher("/tf", "/amcl"), subscriber("/tf", "/move_base"))
    hub.book = hub.book.advertised([Rule(Kind.PUBLISHER, "/tf")]).added(
        "flip", [to("robot", Kind.SUBSCRIBER, "/tf", "/rviz")]
    )
    robot.book = robot.book.added("pull", [to("hub", Kind.PUBLISHER, "/tf")])
    fleet_of(hub, robot)
    assert robot.imported() == {("/tf", "hub", "/gazebo")}
    assert hub.imported() == {("/tf", "robot", "/amcl")}


def test_a_firewall_refuses_flips_and_reports_it_and_lets_pulls_through() -> None:
    hub = gateway("hub", publisher("/a"), firewall=True)
    robot = gateway("robot", publisher("/b"))
    hub.book = hub.book.advertised([Rule(Kind.PUBLISHER, "/a")])
    robot.book = robot.book.added(
        "flip", [to("hub", Kind.PUBLISHER, "/b"), to("hub", Kind.SUBSCRIBER, "/c")]
    ).added("pull", [to("hub", Kind.PUBLISHER, "/a")])
    fleet_of(hub, robot)
    assert robot.states() == {
        "flip /b": State.FIREWALLED,
        "flip /c": State.FIREWALLED,
        "pull /a": State.ACTIVE,
    }
    assert hub.imported() == set()
    assert robot.outcome.flipped[0].status == "blocked"


def test_a_firewall_that_falls_lets_the_flip_in() -> None:
    hub, robot = gateway("hub", firewall=True), gateway("robot", publisher("/b"))
    robot.book = robot.book.added("flip", [to("hub", Kind.PUBLISHER, "/b")])
    fleet = fleet_of(hub, robot)
    hub.firewall = False
    fleet.settle()
    assert robot.states() == {"flip /b": State.ACTIVE}


def test_what_is_blacklisted_does_not_leave_and_the_rule_says_why() -> None:
    hub = FakeGateway(
        RuleBook("hub", (Rule(Kind.PUBLISHER, "/rosout.*"),)),
        {publisher("/rosout"), publisher("/a")},
    )
    robot = gateway("robot")
    hub.book = hub.book.added(
        "flip", [to("robot", Kind.PUBLISHER, "/ros.*"), to("robot", Kind.PUBLISHER, ALL)]
    )
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/rosout")])
    fleet_of(hub, robot)
    assert robot.imported() == {("/a", "hub", "/talker")}
    assert hub.states()["flip /ros.*"] == "blacklisted by publisher /rosout.*"
    assert robot.states()["flip /rosout"] == "blacklisted by publisher /rosout.*"


def test_a_flip_alls_own_blacklist_bars_only_there() -> None:
    hub, robot = gateway("hub", publisher("/a"), publisher("/b")), gateway("robot")
    hub.book = hub.book.with_all("flip", "robot", [Rule(Kind.PUBLISHER, "/a")]).advertised(
        [Rule(Kind.PUBLISHER, "/a")]
    )
    fleet_of(hub, robot)
    assert robot.imported() == {("/b", "hub", "/talker")}
    assert [one.name for one in hub.outcome.advertised] == ["/a"]


def test_a_subscriber_of_another_type_bars_no_topic() -> None:
    """A master lists one type per topic, and a subscriber's stays even after the subscriber has ended."""
    hub = gateway("hub", publisher("/a", kind="std_msgs/Int32"))
    robot = gateway("robot", subscriber("/a"))
    hub.book = hub.book.added("flip", [to("robot", Kind.PUBLISHER, "/a")])
    fleet_of(hub, robot)
    assert robot.imported() == {("/a", "hub", "/talker")}


def test_types_of_publishers_that_differ_are_reported_and_not_connected() -> None:
    hub = gateway("hub", publisher("/a", kind="std_msgs/Int32"))
    robot = gateway("robot", publisher("/a", "/other"), subscriber("/a"))
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/a")])
    hub.book = hub.book.added("flip", [to("robot", Kind.PUBLISHER, "/a")])
    fleet_of(hub, robot)
    assert robot.outcome.imports == frozenset()
    assert robot.states() == hub.states() == {"flip /a": State.TYPE_MISMATCH}
    assert robot.reason("/a") == "/a is std_msgs/String at robot and std_msgs/Int32 at hub"


@pytest.mark.parametrize(
    ("rule", "state", "reason"),
    [
        (to("rbot", Kind.SUBSCRIBER, "/a"), State.NO_GATEWAY, "nearest on the hub: robot"),
        (
            to("robot", Kind.SUBSCRIBER, "/p1/base_scam"),
            State.NO_TOPIC,
            "nearest there: /p1/base_scan",
        ),
        (
            to("robot", Kind.SUBSCRIBER, "/heard"),
            State.NO_PUBLISHER,
            "subscribed there, but not published",
        ),
        (to("robot", Kind.PUBLISHER, "/chater"), State.NO_TOPIC, "nearest here: /chatter"),
        (
            to("robot", Kind.PUBLISHER, "/chatter", "/tacker"),
            State.NO_PUBLISHER,
            "published by /talker, not /tacker",
        ),
        (to("robot", Kind.SERVICE, "/ad"), State.NO_SERVICE, "nearest here: /add"),
        (
            to("robot", Kind.SERVICE, "/add", "/talker"),
            State.NO_SERVER,
            "here it is served by /adder, not /talker",
        ),
        (to("robot", Kind.ACTION_SERVER, "/fib"), State.NO_ACTION, "there is no action here"),
    ],
)
def test_a_typo_is_answered_with_what_exists(rule: RemoteRule, state: State, reason: str) -> None:
    hub = gateway("hub", publisher("/chatter"), service("/add", "/adder"))
    robot = gateway("robot", publisher("/p1/base_scan"), subscriber("/heard"))
    hub.book = hub.book.added("flip", [rule])
    fleet_of(hub, robot)
    assert list(hub.states().values()) == [state]
    assert reason in hub.reason(rule.rule.name)


def test_a_topic_for_a_node_that_does_not_listen_reports_it_and_who_does() -> None:
    hub, robot = (
        gateway("hub", subscriber("/a", "/rviz")),
        gateway("robot", publisher("/a"), publisher("/b")),
    )
    hub.book = hub.book.added(
        "flip",
        [to("robot", Kind.SUBSCRIBER, "/a", "/rvzi"), to("robot", Kind.SUBSCRIBER, "/b", "/rviz")],
    )
    fleet_of(hub, robot)
    assert hub.states() == {"flip /a": State.ACTIVE, "flip /b": State.ACTIVE}
    cure = "'rosrun rocon_gateway flip robot /a -t subscriber'"
    assert hub.reason("/a") == (
        "for /rvzi, which does not listen yet; here it is also subscribed by /rviz, "
        f"not covered by a rule; to cover every node: {cure}"
    )
    assert hub.reason("/b") == "for /rviz, which does not listen yet"
    hub.local = frozenset({subscriber("/a", "/rvzi"), subscriber("/b", "/rviz")})
    fleet_of(hub, robot)
    assert hub.reason("/a") == hub.reason("/b") == ""


def test_a_flip_for_one_node_names_the_subscribers_it_does_not_cover() -> None:
    hub = gateway("hub", subscriber("/tf", "/rviz"), subscriber("/tf", "/tf_echo"))
    robot = gateway("robot", publisher("/tf"))
    hub.book = hub.book.added("flip", [to("robot", Kind.SUBSCRIBER, "/tf", "/rviz")])
    fleet_of(hub, robot)
    assert hub.reason("/tf").startswith(
        "only for /rviz; here it is also subscribed by /tf_echo, not covered by a rule"
    )
    hub.book = hub.book.added("flip", [to("robot", Kind.SUBSCRIBER, "/tf", "")])
    fleet_of(hub, robot)
    assert hub.reason("/tf") == ""


def test_rules_wait_for_a_hub() -> None:
    book = RuleBook("hub").added("flip", [to("robot", Kind.PUBLISHER, "/a")])
    (state,) = reconcile(Situation(book, False, frozenset(), connected=False)).states
    assert (state.verdict.state, state.verdict.reason) == (State.PENDING, "waiting for a hub")


def test_one_rule_may_mean_several_gateways() -> None:
    hub, one, two = (
        gateway("hub"),
        gateway("aadi1_gateway", publisher("/a")),
        gateway("aadi2_gateway"),
    )
    hub.book = hub.book.added("flip", [to("aadi._gateway", Kind.SUBSCRIBER, "/a")])
    Fleet(hub, one, two).settle()
    assert hub.imported() == {("/a", "aadi1_gateway", "/talker")}
    assert hub.states() == {"flip /a": State.ACTIVE}


def test_three_that_flip_everything_in_a_ring_carry_each_publisher_once() -> None:
    ring = [gateway(name, publisher("/tf", f"/from_{name}")) for name in ("a", "b", "c")]
    for this, after in zip(ring, ring[1:] + ring[:1], strict=True):
        this.book = this.book.with_all("flip", after.name, [])
    Fleet(*ring).settle()
    for this, before in zip(ring, ring[-1:] + ring[:-1], strict=True):
        assert this.imported() == {("/tf", before.name, f"/from_{before.name}")}


def test_two_that_advertise_and_pull_everything_carry_each_publisher_once() -> None:
    left, right = (
        gateway("left", publisher("/a", "/left_node")),
        gateway("right", publisher("/a", "/right_node")),
    )
    for one, other in ((left, right), (right, left)):
        one.book = one.book.advertising_all([]).with_all("pull", other.name, [])
    fleet_of(left, right)
    assert left.imported() == {("/a", "right", "/right_node")}
    assert right.imported() == {("/a", "left", "/left_node")}
    assert [one.node for one in left.outcome.advertised] == ["/left_node"]


def test_a_cancelled_rule_takes_everything_back() -> None:
    hub, robot = gateway("hub", publisher("/a")), gateway("robot")
    empty, rules = robot.book, [to("hub", Kind.SUBSCRIBER, "/a")]
    robot.book = empty.added("flip", rules)
    fleet = fleet_of(hub, robot)
    assert robot.outcome.imports
    robot.book = robot.book.removed("flip", rules)
    fleet.settle()
    assert robot.book == empty
    for one in (hub, robot):
        assert one.outcome == Outcome()


def test_a_broken_link_is_the_rules_state() -> None:
    hub, robot = gateway("hub", publisher("/a")), gateway("robot")
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/a")])
    fleet = fleet_of(hub, robot)
    robot.links = {
        one: dataclasses.replace(link, state=LinkState.UNREACHABLE, reason="no route")
        for one, link in robot.links.items()
    }
    (state,) = reconcile(fleet.situation(robot)).states
    assert (state.verdict.state, state.verdict.reason) == (State.UNREACHABLE, "no route")


def test_what_was_not_wanted_is_not_imported_though_offered() -> None:
    hub, robot = gateway("hub", publisher("/a")), gateway("robot")
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/a")])
    fleet = fleet_of(hub, robot)
    robot.book = RuleBook("robot")
    assert reconcile(fleet.situation(robot)).imports == frozenset()


def test_a_proxy_never_takes_the_name_of_a_node_that_is_here() -> None:
    hub, robot = (
        gateway("hub", publisher("/a", "/amcl")),
        gateway("robot", subscriber("/a", "/hub/amcl")),
    )
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/a")])
    fleet_of(hub, robot)
    assert robot.imported() == set()
    assert robot.states() == {"flip /a": State.REFUSED}
    assert robot.reason("/a") == "a node /hub/amcl is here already"


def test_options_go_to_the_links_that_they_mean_at_either_end() -> None:
    hub = gateway("hub", publisher("/image"), publisher("/map"))
    robot = gateway("robot", subscriber("/image"))
    hub.options = (option_rule({"name": "/map", "gateway": "robot", "compress": True}),)
    robot.options = (option_rule({"name": "/image", "node": "/talker", "rate": 2}),)
    hub.book = hub.book.added("flip", [to("robot", Kind.PUBLISHER, "/map")])
    robot.book = robot.book.added("flip", [to("hub", Kind.SUBSCRIBER, "/image")])
    fleet_of(hub, robot)
    assert {one.topic: one.options for one in hub.outcome.exports} == {
        "/map": LinkOptions(compress=True),
        "/image": NO_OPTIONS,
    }
    assert {one.topic: one.options for one in robot.outcome.imports} == {
        "/map": NO_OPTIONS,
        "/image": LinkOptions(rate=2),
    }
    assert robot.states() == {"flip /image": "rate-limited"}


def hub_of_three_robots() -> FakeGateway:
    return gateway(
        "hub",
        *(publisher(f"/pioneer{number}/odom", "/gazebo") for number in (1, 2, 3)),
        publisher("/map"),
    )


def test_a_pattern_pulls_nothing_out_of_another_robots_namespace() -> None:
    hub, robot = hub_of_three_robots(), gateway("aadi1")
    hub.book = hub.book.advertising_all([])
    robot.namespace = "pioneer1"
    robot.book = robot.book.with_all("pull", "hub", [])
    fleet_of(hub, robot)
    assert {topic for topic, _, _ in robot.imported()} == {"/pioneer1/odom", "/map"}
    robot.book = robot.book.without("pull", "hub").added(
        "pull", [to("hub", Kind.PUBLISHER, "/pioneer2/.*")]
    )
    fleet_of(hub, robot)
    assert {topic for topic, _, _ in robot.imported()} == {"/pioneer2/odom"}


def test_a_pattern_flips_nothing_of_another_robots_namespace_and_reports_it() -> None:
    hub, robot = hub_of_three_robots(), gateway("aadi1")
    robot.namespace = "pioneer1"
    hub.book = hub.book.added(
        "flip", [to("aadi1", Kind.PUBLISHER, ".*[2]/odom"), to("aadi1", Kind.PUBLISHER, ".*1/odom")]
    )
    fleet_of(hub, robot)
    assert {topic for topic, _, _ in robot.imported()} == {"/pioneer1/odom"}
    assert hub.states() == {"flip .*[2]/odom": "refused", "flip .*1/odom": "active"}
    assert "/pioneer2" in hub.reason(".*[2]/odom")
    hub.book = hub.book.added("flip", [to("aadi1", Kind.PUBLISHER, "/pioneer2/odom")])
    fleet_of(hub, robot)
    assert hub.states()["flip /pioneer2/odom"] == "active"


def test_robots_of_any_name_are_kept_apart_once_their_gateways_are_known() -> None:
    hub = gateway(
        "hub", *(publisher(f"/{name}/odom", "/gazebo") for name in ("alice", "bob", "map_server"))
    )
    hub.book = hub.book.advertising_all([])
    hub.book = hub.book.added("flip", [to("alice_gw", Kind.PUBLISHER, "/b.*/odom")])
    alice, bob = gateway("alice_gw"), gateway("bob_gw")
    alice.namespace, bob.namespace = "alice", "bob"
    alice.book = alice.book.added("pull", [to("hub", Kind.PUBLISHER, ".*/odom")])
    bob.book = bob.book.added("pull", [to("hub", Kind.PUBLISHER, "/alice/.*")])
    Fleet(hub, alice, bob).settle()
    assert {topic for topic, _, _ in alice.imported()} == {"/alice/odom", "/map_server/odom"}
    assert hub.states()["flip /b.*/odom"] == "refused"
    assert {topic for topic, _, _ in bob.imported()} == {"/alice/odom"}, (
        "what spells the namespace out is asked for"
    )
    Fleet(hub, alice).settle()
    assert "/bob/odom" in {topic for topic, _, _ in alice.imported()}, "nobody has told of bob"


def test_publishers_that_are_other_robots_nodes_are_left_out_by_an_option() -> None:
    nodes = (
        "/gazebo",
        "/static",
        "/pioneer1/state_publisher",
        "/pioneer2/state_publisher",
        "/bob/state_publisher",
    )
    hub = gateway(
        "hub",
        *(publisher("/tf", node) for node in nodes),
        publisher("/joints", "/bob/state_publisher"),
    )
    hub.book = hub.book.advertising_all([])
    robot, other = gateway("aadi1"), gateway("bob_gateway")
    robot.namespace, other.namespace = "pioneer1", "bob"
    robot.options = (option_rule({"name": "/tf", "foreign_nodes": False, "compress": True}),)
    robot.book = robot.book.added(
        "pull", [to("hub", Kind.PUBLISHER, "tf"), to("hub", Kind.PUBLISHER, "joints")]
    )
    Fleet(hub, robot, other).settle()
    assert {node for topic, _, node in robot.imported() if topic == "/tf"} == {*nodes[:3]}
    assert {one.options.compress for one in robot.outcome.imports} == {True, False}
    assert ("/joints", "hub", "/bob/state_publisher") in robot.imported(), "the option is of /tf"
    assert robot.states() == {"pull tf": "active", "pull joints": "active"}
    asked = {want.node for want in robot.outcome.requests["hub"].wants if want.topic == "/tf"}
    assert asked == {*nodes[:3]}, "the others are not asked for"

    hub.local -= {publisher("/tf", node) for node in nodes[:3]}
    Fleet(hub, robot, other).settle()
    assert robot.states()["pull tf"] == "refused"
    assert "rule_options of aadi1" in robot.reason("tf")


def test_a_gateway_without_a_robots_namespace_gets_everything() -> None:
    hub, robot = hub_of_three_robots(), gateway("base2")
    hub.book = hub.book.advertising_all([])
    robot.book = robot.book.with_all("pull", "hub", [])
    fleet_of(hub, robot)
    assert len(robot.imported()) == 4


def test_a_dead_node_bars_neither_its_name_nor_its_topic() -> None:
    hub = gateway(
        "hub", publisher("/old", "/robot/talker"), publisher("/chatter", "/ghost", "std_msgs/Int32")
    )
    robot = gateway("robot", publisher("/chatter"), publisher("/other"))
    for topic in ("/chatter", "/other"):
        hub.book = hub.book.added("flip", [to("robot", Kind.SUBSCRIBER, topic)])
    fleet = fleet_of(hub, robot)
    assert hub.states() == {
        "flip /chatter": State.TYPE_MISMATCH,
        "flip /other": State.REFUSED,
    }
    assert hub.outcome.barring == {"/robot/talker", "/ghost"}
    hub.dead = frozenset({"/ghost"})
    fleet.settle()
    assert hub.states()["flip /other"] == State.REFUSED
    hub.dead = frozenset({"/robot/talker", "/ghost"})
    fleet.settle()
    assert hub.imported() == {("/chatter", "robot", "/talker"), ("/other", "robot", "/talker")}
    assert hub.outcome.barring == {"/robot/talker", "/ghost"}, "they stay under examination"


def test_one_living_publisher_of_several_bars_another_type() -> None:
    hub = gateway("hub", *(publisher("/chatter", node, "std_msgs/Int32") for node in ("/a", "/b")))
    robot = gateway("robot", publisher("/chatter"))
    hub.book = hub.book.added("flip", [to("robot", Kind.SUBSCRIBER, "/chatter")])
    hub.dead = frozenset({"/a"})
    fleet_of(hub, robot)
    assert hub.states() == {"flip /chatter": State.TYPE_MISMATCH}


def test_gateways_whose_names_differ_in_punctuation_have_proxies_of_their_own() -> None:
    here = gateway("here")
    here.book = here.book.added("flip", [to("pi.*", Kind.SUBSCRIBER, "/chatter")])
    others = [gateway(name, publisher("/chatter")) for name in ("pi-1", "pi_1", "pi.1", "pi-2")]
    Fleet(here, *others).settle()
    proxies = {one.source_gateway: one.proxy for one in here.outcome.imports}
    assert len(set(proxies.values())) == 4
    assert proxies["pi_1"] == "/pi_1/talker"
    assert proxies["pi-2"] == "/pi_2/talker", "alone, a name needs no suffix"
    assert proxies["pi-1"].startswith("/pi_1_")
