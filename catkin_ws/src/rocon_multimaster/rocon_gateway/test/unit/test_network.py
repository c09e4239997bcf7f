"""The network picture: arrows between gateways, as text and for Graphviz."""

from rocon_gateway.commands.network import LABEL_LINES, Member, arrows, dot, text
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule

SCAN = Rule(Kind.SUBSCRIBER, "/p1/scan", "/rviz")
MAP = Rule(Kind.PUBLISHER, "/map")
BASE = Member(
    "Hub_Gateway",
    advertised=(MAP,),
    flips=(RemoteRule("aadi1_gateway", SCAN), RemoteRule("aadi2", SCAN)),
)
ROBOT = Member("aadi1_gateway" + "0" * 32, pulls=(RemoteRule("Hub_.*", MAP),), alive=False)


def test_rules_point_to_the_gateways_they_mean_and_to_those_that_are_missing() -> None:
    found = {(one.action, one.origin, one.target, one.missing) for one in arrows([ROBOT, BASE])}
    assert found == {
        ("flip", BASE.name, ROBOT.name, False),
        ("flip", BASE.name, "aadi2", True),
        ("pull", ROBOT.name, BASE.name, False),
    }


def test_the_text_names_everything_and_says_what_is_wrong() -> None:
    lines = text("Pioneer Hub", [ROBOT, BASE]).splitlines()
    assert lines[0] == "hub Pioneer Hub"
    assert "  aadi1_gateway  (not heard of)" in lines
    assert "    flip <-- aadi2  (no such gateway)" in lines
    assert "    advertises publisher /map" in lines
    assert lines.count("      subscriber /p1/scan of /rviz") == 2


def test_the_graph_has_the_figures_colours_and_is_quoted() -> None:
    drawn = dot('the "hub"', [BASE, ROBOT])
    assert 'label="the \\"hub\\""' in drawn
    assert drawn.count("[color=purple,") == 2 + 2, "two in the legend"
    assert drawn.count("style=dashed") == 1 + 1
    assert f'"Hub_Gateway" -> "{ROBOT.name}" [color=green4' in drawn


def test_arrows_point_where_data_go() -> None:
    rules = [Rule(kind, "/x") for kind in (Kind.PUBLISHER, Kind.SUBSCRIBER, Kind.SERVICE)]
    flips = tuple(RemoteRule("b", rule) for rule in rules)
    ends = {
        (one.action, one.ends)
        for one in arrows([Member("a", flips=flips, pulls=flips[:1]), Member("b")])
    }
    assert ends == {("flip", ("a", "b")), ("flip", ("b", "a")), ("pull", ("b", "a"))}


def test_a_long_label_is_cut_and_counted() -> None:
    many = tuple(
        RemoteRule("b", Rule(Kind.PUBLISHER, f"/t{number}")) for number in range(LABEL_LINES + 5)
    )
    assert "\\nand 5 more" in dot("", [Member("a", flips=many), Member("b")])
