"""The gateway's parameters: rocon's launch files are understood, and one invalid rule does not affect any other."""

import pytest

from rocon_gateway.error import ConfigError
from rocon_gateway.node.config import GatewayConfig, book_from_config, with_custom_rules
from rocon_gateway.rules.matching import ALL
from rocon_hub_protocol.record import is_gateway_name
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule


def test_a_unique_name_has_32_digits_more_unless_told_not_to() -> None:
    name = GatewayConfig(name="pirate").unique_name()
    assert name.startswith("pirate")
    assert len(name) == len("pirate") + 32
    assert GatewayConfig(name="Hub_Gateway", disable_uuids=True).unique_name() == "Hub_Gateway"


@pytest.mark.parametrize(
    "values",
    [
        {"name": " "},
        {"name": "a\nb"},
        {"name": "x" * 225},
        {"name": "x" * 257, "disable_uuids": True},
        {"watch_loop_period": 0.0},
        {"watch_loop_period": float("nan")},
        {"relay_port": -1},
    ],
)
def test_a_value_that_cannot_be_meant_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        GatewayConfig(**values)


def test_a_name_as_long_as_others_accept_is_taken() -> None:
    for config in (
        GatewayConfig(name="x" * 224),
        GatewayConfig(name="x" * 256, disable_uuids=True),
    ):
        assert is_gateway_name(config.unique_name())


def test_hub_lists_may_be_lists_or_texts() -> None:
    assert GatewayConfig(hub_whitelist=["a", "b"]).hubs_allowed == ("a", "b")
    assert GatewayConfig(hub_blacklist="a; b;").hubs_refused == ("a", "b")
    with pytest.raises(ConfigError):
        _ = GatewayConfig(hub_whitelist=[1]).hubs_allowed


def test_default_rules_become_rules() -> None:
    config = GatewayConfig(
        default_blacklist=[{"name": "/rosout.*", "node": None, "type": "publisher"}],
        default_advertisements=[{"name": "/map", "node": "None", "type": "publisher"}],
        default_flips=[
            {
                "gateway": "pirate",
                "rule": {"name": "/odom", "node": "/nonesuch", "type": "subscriber"},
            }
        ],
        default_pulls=[{"gateway": "pirate"}],
    )
    book, complaints = book_from_config(config, "mine")
    assert complaints == ()
    assert book.blacklist == (Rule(Kind.PUBLISHER, "/rosout.*"),)
    assert book.advertisements.rules == (Rule(Kind.PUBLISHER, "/map"),)
    assert book.flips.rules == (RemoteRule("pirate", Rule(Kind.SUBSCRIBER, "/odom", "/nonesuch")),)
    assert {remote.rule.name for remote in book.pulls.rules} == {ALL}


def test_a_bad_default_rule_is_named_and_the_others_are_taken() -> None:
    config = GatewayConfig(
        default_blacklist=[{"name": "(", "type": "publisher"}],
        default_flips=[
            {"rule": {"name": "/a", "type": "publisher"}},
            {"gateway": "mine", "rule": {"name": "/a", "type": "publisher"}},
            {"gateway": "pirate", "rule": {"name": "/a", "type": "publisher"}},
            "pirate",
        ],
    )
    book, complaints = book_from_config(config, "mine")
    assert [remote.gateway for remote in book.flips.rules] == ["pirate"]
    assert len(complaints) == 4


def test_advertise_all_may_be_an_empty_list_for_no() -> None:
    assert not book_from_config(GatewayConfig(advertise_all=[]), "mine")[
        0
    ].advertisements.everything
    assert book_from_config(GatewayConfig(advertise_all=True), "mine")[0].advertisements.everything


def test_a_custom_rules_file_appends_rules_and_replaces_the_rest() -> None:
    merged = with_custom_rules(
        {"default_flips": [1], "firewall": True}, {"default_flips": [2], "firewall": False}
    )
    assert merged == {"default_flips": [1, 2], "firewall": False}
    assert with_custom_rules({"name": "a"}, None) == {"name": "a"}
    options = with_custom_rules({"rule_options": ["ours"]}, {"rule_options": ["the user's"]})[
        "rule_options"
    ]
    assert options == ["the user's", "ours"], "the first row that matches counts"
    with pytest.raises(ConfigError):
        with_custom_rules({}, ["rules"])


def test_namespaces_of_robots_may_be_declared_and_must_be_names() -> None:
    config = GatewayConfig(namespace="/pioneer1", robot_namespaces="alice; /bob")
    assert (config.own_namespace, config.known_namespaces) == (
        "pioneer1",
        {"pioneer1", "alice", "bob"},
    )
    assert GatewayConfig().known_namespaces == set()
    for wrong in (
        {"namespace": "a/b"},
        {"robot_namespaces": ["a b"]},
        {"robot_namespaces": 3},
        {"namespace": "7"},
    ):
        with pytest.raises(ConfigError):
            GatewayConfig(**wrong)
