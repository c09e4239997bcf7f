"""Faults of the original, each with the tests that show it fixed; those not tested elsewhere are tested below."""

import re
import time
from pathlib import Path

import pytest
from gateway_msgs import msg, srv

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

MULTIMASTER = Path(__file__).parents[3]

FAULTS = {
    "a bad pattern or unknown type kills the loop, and services keep answering 0": [
        "test_bad_requests_are_refused_and_everything_continues",
        "test_a_bad_default_rule_is_named_and_the_others_are_taken",
    ],
    "a flip of exactly .* without flip_all kills the loop": [
        "test_bad_requests_are_refused_and_everything_continues"
    ],
    "a flip_all's extra blacklist leaks into the shared default": [
        "test_a_flip_alls_own_blacklist_bars_only_there",
        "test_flipping_all_replaces_that_gateways_flips_and_its_blacklist_ends_with_it",
        "test_a_blacklist_of_flip_all_ends_with_it_and_stays_private",
    ],
    "unadvertising /a of /a, /b, /c removes /c": [
        "test_unadvertising_one_of_three_leaves_the_other_two"
    ],
    "ending advertise_all or flip_all may leave rules": [
        "test_advertising_all_replaces_and_ending_it_clears",
        "test_flips_show_exactly_the_five_accepted",
    ],
    "a service name clash is accepted and retried each second": [
        "test_a_taken_service_name_is_blocked_until_its_server_is_gone",
        "test_a_local_server_keeps_its_name_and_the_rule_is_refused_not_accepted",
    ],
    "a firewall that was seen once is never asked again": [
        "test_a_firewall_that_falls_lets_the_flip_in"
    ],
    "nobody knows whether data arrives": [
        "test_a_broken_link_is_the_rules_state",
        "test_a_black_holed_link_is_noticed_within_10_s_and_reconnects",
    ],
    "flipping a roscpp subscriber cuts it off from its local publishers": [
        "test_a_flipped_roscpp_subscriber_keeps_its_local_publishers"
    ],
    "rospy subscribers still receive an unflipped topic": [
        "test_flips_and_pulls_bring_messages_at_once_and_cancelling_ends_them"
    ],
    "a new publisher is seen after up to 10 s": [
        "test_a_new_publisher_of_a_running_rule_is_heard_within_a_second"
    ],
    "losing the hub unregisters everything": [
        "test_a_killed_hub_stops_no_data_and_its_return_restores_everything"
    ],
    "shutting down leaves registrations, hangs or crashes without a hub": [
        "test_shutting_down_in_any_order_leaves_nothing_behind",
        "test_a_gateway_whose_hub_is_gone_ends_at_once",
        "test_a_gateway_whose_master_is_gone_reports_it_once_and_ends",
    ],
    "a killed gateway is noticed after 31 s, or never": [
        "test_a_killed_gateway_is_noticed_and_a_new_one_takes_its_place"
    ],
    "the hub uses somebody else's Redis, and its own outlives it": [
        "test_a_busy_port_is_one_clear_line_and_the_first_hub_continues",
        "test_no_redis_outlives_its_hub",
    ],
    "values that any client writes on the hub are unpickled": [
        "test_garbage_in_redis_values_does_no_harm"
    ],
    "any client that can reach the hub may use it": [
        "test_a_password_is_asked_for_and_kept_out_of_the_log",
        "test_without_a_password_only_this_machine_may_connect",
    ],
    "registrations carry the address of the start": [
        "test_a_moved_relay_is_dialled_at_its_new_address",
        "test_a_hub_that_moves_is_found_again",
    ],
    "identical robots get each other's topics": [
        "test_a_pattern_pulls_nothing_out_of_another_robots_namespace",
        "test_robots_of_any_name_are_kept_apart_once_their_gateways_are_known",
    ],
    "a base name means every match, unsaid": [
        "test_one_rule_may_mean_several_gateways",
        "test_gateways_of_one_name_are_found_by_their_base_name",
    ],
    "rings of three echo, and what was pulled is advertised again": [
        "test_in_a_ring_of_three_that_flips_everything_each_message_comes_once",
        "test_what_was_flipped_here_is_not_advertised_here",
        "test_two_that_advertise_and_pull_everything_carry_each_publisher_once",
    ],
    "connect_hub without a scheme raises": ["test_connect_hub_takes_an_address_without_a_scheme"],
    "connect_hub remembers a refusal for ever": ["test_each_call_of_connect_hub_looks_again"],
    "an empty node in flip_watchlist is the text None": [
        "test_a_default_flip_by_base_name_stands_before_and_after_its_gateway_comes"
    ],
    "the network interface cannot be set by gateway.launch": [
        "test_the_launch_files_have_rocons_arguments_with_their_defaults"
    ],
    "a gateway's name must not hold a colon, nor what the hub globs": [
        "test_parts_may_come_in_any_order"
    ],
    "a node called nonesuch counts as none": ["test_default_rules_become_rules"],
}


def test_every_fault_of_the_original_has_tests_that_exist() -> None:
    files = [*MULTIMASTER.glob("*/test/**/test_*.py")]
    there = {
        name
        for file in files
        for name in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)
    }
    assert {name for names in FAULTS.values() for name in names} <= there


def test_a_flipped_roscpp_subscriber_keeps_its_local_publishers(fleet, pair) -> None:
    """The roscpp node is topic_tools' relay, which copies every message it receives."""
    base, robot = pair
    base.talk("/chatter", "local")
    argv = ["/usr/lib/topic_tools/relay", "/chatter", "/copy", "__name:=copier"]
    fleet.group.start("copier", argv, base.master.environment, fleet.folder / "copier.log")
    wait_until(lambda: base.publishers("/copy"), "roscpp's relay knows the type", 30)
    ear = base.hear("/copy")
    ear.first_after(0.0, "local")
    robot.talk("/chatter", "far")
    assert base.flip("robot", "subscriber", "/chatter", "/copier") == 0
    ear.first_after(0.0, "far")
    flipped = time.monotonic()
    for name in ("local", "far"):
        ear.first_after(flipped, name)
    assert base.flip("robot", "subscriber", "/chatter", "/copier", cancel=True) == 0
    wait_until(lambda: base.publishers("/chatter") == ["/local"], "the far one is gone", 5)
    ear.first_after(time.monotonic(), "local")


def test_a_blacklist_of_flip_all_ends_with_it_and_stays_private(pair) -> None:
    base, robot = pair
    base.talk("/secret")
    barred = [msg.Rule("publisher", "/secret", "")]
    assert base.call("advertise_all", srv.AdvertiseAll).result == 0
    assert base.call("flip_all", srv.RemoteAll, gateway="robot", blacklist=barred).result == 0
    wait_until(
        lambda: "/secret" in {rule.name for rule in base.info().public_interface},
        "advertised all the same",
        5,
    )
    assert robot.publishers("/secret") == []
    assert base.call("flip_all", srv.RemoteAll, gateway="robot", cancel=True).result == 0
    assert base.call("flip_all", srv.RemoteAll, gateway="robot").result == 0
    wait_until(lambda: robot.publishers("/secret") == ["/base/talker"], "flipped now", 5)


def test_a_new_publisher_of_a_running_rule_is_heard_within_a_second(standing, report) -> None:
    base, robot = standing
    ears = {
        "/exact": base.hear("/exact", "hears_exact"),
        "/matched": base.hear("/matched", "hears_matched"),
    }
    assert base.flip("robot", "subscriber", "/exact") == 0
    assert base.flip("robot", "subscriber", "/match.*") == 0
    wait_until(lambda: base.states()["flip /exact"].startswith("no such topic"), "the rules run", 5)
    for topic, ear in ears.items():
        robot.talk(topic, f"talks{topic[1:]}")
        took = ear.first_after(time.monotonic())
        report(f"new publisher {topic}", took)
        assert took < 1.0


def test_a_refused_or_untimely_request_answers_its_code_and_changes_nothing(fleet) -> None:
    codes = msg.ErrorCodes
    lone = fleet.site("lone").start()
    for action in ("flip_all", "pull_all"):
        assert lone.call(action, srv.RemoteAll, gateway="robot").result == codes.NO_HUB_CONNECTION
        assert (
            lone.call(action, srv.RemoteAll, gateway="robot", cancel=True).result == codes.SUCCESS
        )
    assert lone.call("advertise_all", srv.AdvertiseAll).result == codes.SUCCESS
    assert lone.call("advertise_all", srv.AdvertiseAll).result == codes.ADVERTISEMENT_EXISTS
    assert lone.call("advertise_all", srv.AdvertiseAll, cancel=True).result == codes.SUCCESS
    both = [
        msg.RemoteRule("robot", msg.Rule("publisher", "/a", "")),
        msg.RemoteRule("lone", msg.Rule()),
    ]
    assert lone.call("flip", srv.Remote, remotes=both).result != codes.SUCCESS
    bad = [msg.Rule("publisher", "/a", ""), msg.Rule("nothing", "/b", "")]
    assert (
        lone.call("advertise", srv.Advertise, rules=bad).result == codes.UNKNOWN_ADVERTISEMENT_ERROR
    )
    period = lone.call("set_watcher_period", srv.SetWatcherPeriod, period=3.0).last_period
    assert lone.call(
        "set_watcher_period", srv.SetWatcherPeriod, period=period
    ).last_period == pytest.approx(3.0)
    # The gateway publishes the new state shortly after its answer.
    wait_until(lambda: not watchlists(lone), "nothing is asked for", 5)
    assert lone.master.system_state()[1]["/gateway/force_update"] == ["/gateway"]


def watchlists(site) -> list:
    info = site.info()
    return [*info.flip_watchlist, *info.public_watchlist, *info.pull_watchlist]


def test_parameters_set_before_the_launch_file_count_on_a_running_master(fleet) -> None:
    fleet.start_hub()
    base = fleet.site("base")
    flip = {"gateway": "robot", "rule": {"name": "/a", "node": "", "type": "publisher"}}
    base.master.set_param("/gateway/default_flips", [flip])
    argv = [
        "roslaunch",
        "rocon_gateway",
        "gateway.launch",
        "gateway_name:=base",
        f"gateway_hub_uri:={fleet.hub_uri}",
    ]
    fleet.group.start("launch", argv, base.master.environment, base.log)
    wait_until(lambda: "/gateway/gateway_info" in base.master.system_state()[0], "the gateway", 60)
    base.connected()
    (kept,) = base.info().flip_watchlist
    assert (kept.gateway, kept.rule) == ("robot", msg.Rule("publisher", "/a", ""))
    assert base.info().firewall is True
