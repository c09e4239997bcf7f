"""Names, nodes and gateways match in full; relative names also match in our namespace, gateways by base name."""

import pytest
from gateway_msgs.msg import ConnectionType, ErrorCodes

from rocon_gateway.error import RequestError
from rocon_gateway.rules.matching import (
    ALL,
    absolute_name,
    base_name,
    blacklisting,
    gateway_matches,
    is_literal,
    name_matches,
    node_matches,
    rule_from_text,
    rule_matches,
)
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import CONNECTIONS, Connection, Kind, Rule

UUID = "0123456789abcdef0123456789abcdef"


def test_the_core_knows_the_codes_and_kinds_of_the_messages() -> None:
    assert {code.name: int(code) for code in Code} == {
        name: value for name, value in vars(ErrorCodes).items() if name.isupper()
    }
    assert {str(kind) for kind in CONNECTIONS} == {
        value
        for name, value in vars(ConnectionType).items()
        if name.isupper() and name != "INVALID"
    }


@pytest.mark.parametrize(
    ("pattern", "name", "matches"),
    [
        ("/chatter", "/chatter", True),
        ("chatter", "/chatter", True),
        ("chatter", "/mine/chatter", True),
        ("chatter", "/other/chatter", False),
        ("/chat", "/chatter", False),
        ("/chat.*", "/chatter", True),
        ("/a|/ab", "/ab", True),
        (ALL, "/anything/at/all", True),
        ("/", "/chatter", False),
    ],
)
def test_a_name_matches_whole_and_relative_ones_too(pattern: str, name: str, matches: bool) -> None:
    assert name_matches(pattern, name, "mine") is matches


def test_an_empty_node_means_any_and_another_matches_whole() -> None:
    assert node_matches("", "/rviz")
    assert node_matches("/rviz.*", "/rviz_1234")
    assert not node_matches("/rviz", "/rviz_1234")


@pytest.mark.parametrize(
    ("pattern", "gateway", "matches"),
    [
        ("pirate", "pirate" + UUID, True),
        ("pirate.*", "pirate" + UUID, True),
        ("pir.te", "pirate" + UUID, False),
        ("pir.te.*", "pirate" + UUID, True),
        ("pirate", "pirate", True),
        ("aadi1_gateway", "aadi11_gateway", False),
        ("aadi1.*", "aadi11_gateway", True),
        ("Hub Gateway", "Hub Gateway", True),
    ],
)
def test_a_gateway_is_met_by_base_name_or_by_its_whole_name(
    pattern: str, gateway: str, matches: bool
) -> None:
    assert gateway_matches(pattern, gateway) is matches


def test_only_a_unique_suffix_is_taken_from_a_name() -> None:
    assert base_name("pirate" + UUID) == "pirate"
    assert base_name(UUID) == UUID
    assert base_name("pirate") == "pirate"


@pytest.mark.parametrize(
    ("kind", "name", "node", "what"),
    [
        ("topic", "/a", "", "unknown connection type 'topic'"),
        ("", "/a", "", "unknown connection type"),
        ("publisher", "", "", "needs a name"),
        ("publisher", "/a(", "", "not a regular expression"),
        ("publisher", "/a", "*", "not a regular expression"),
    ],
)
def test_a_bad_rule_is_refused_with_the_callers_code(
    kind: str, name: str, node: str, what: str
) -> None:
    with pytest.raises(RequestError, match=what) as caught:
        rule_from_text(kind, name, node, Code.UNKNOWN_ADVERTISEMENT_ERROR)
    assert caught.value.code == Code.UNKNOWN_ADVERTISEMENT_ERROR


def test_kind_name_and_node_must_all_match() -> None:
    connection = Connection(Kind.PUBLISHER, "/odom", "nav_msgs/Odometry", "/gazebo")
    assert rule_matches(Rule(Kind.PUBLISHER, "odom", "/gaz.*"), connection, "mine")
    assert not rule_matches(Rule(Kind.SUBSCRIBER, "odom"), connection, "mine")
    assert not rule_matches(Rule(Kind.PUBLISHER, "odom", "/amcl"), connection, "mine")


def test_a_blacklist_names_the_rule_that_bars() -> None:
    connection = Connection(Kind.PUBLISHER, "/rosout_agg", "rosgraph_msgs/Log", "/rosout")
    barrier = Rule(Kind.PUBLISHER, "/rosout.*")
    assert blacklisting([Rule(Kind.SUBSCRIBER, "/rosout.*"), barrier], connection) == barrier
    assert blacklisting([Rule(Kind.PUBLISHER, "rosout_agg")], connection) is None


def test_a_literal_has_no_pattern_in_it() -> None:
    assert is_literal("/pioneer1/base_scan")
    assert not is_literal("/pioneer./base_scan")
    assert absolute_name("chatter") == absolute_name("/chatter") == "/chatter"
