"""The network of a hub as text or graph: which gateway advertises, pulls and flips what."""

from collections.abc import Iterable
from dataclasses import dataclass

from rocon_gateway.rules.matching import base_name, gateway_matches
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule

FLIP_COLOUR = "purple"
PULL_COLOUR = "green4"
"""Colours as in the figure of the tutorial. Flips are direct; advertised connections may be pulled by all."""

_LEGEND = (
    "  subgraph cluster_legend {",
    '    label="arrows point where data go"; style=rounded; color=gray; node [shape=point, width=0.01, label=""];',
    f'    legend_1 -> legend_2 [color={FLIP_COLOUR}, fontcolor={FLIP_COLOUR}, label="flipped"];',
    f'    legend_3 -> legend_4 [color={PULL_COLOUR}, fontcolor={PULL_COLOUR}, label="pulled, or advertised"];',
    f'    legend_5 -> legend_6 [color={FLIP_COLOUR}, style=dashed, label="no such gateway"];',
    "  }",
)

LABEL_LINES = 8
"""Maximum number of topics named at an arrow; the others are only counted."""


@dataclass(frozen=True)
class Member:
    """A gateway of the network."""

    name: str  #: its unique name
    advertised: tuple[Rule, ...] = ()  #: connections that others may pull
    flips: tuple[RemoteRule, ...] = ()  #: its flip rules
    pulls: tuple[RemoteRule, ...] = ()  #: its pull rules
    alive: bool = True  #: whether the hub receives its heartbeats


@dataclass(frozen=True)
class Arrow:
    """Rules of one gateway towards another."""

    action: str  #: "flip" or "pull"
    origin: str  #: the gateway that has the rules
    target: str  #: the other gateway's unique name, or the rule's pattern if it matches none
    missing: bool  #: whether the pattern matches no gateway
    outward: bool  #: whether data, or service requests, flow from the origin to the target
    labels: tuple[str, ...]  #: the rules as readable text

    @property
    def ends(self) -> tuple[str, str]:
        """Source and destination of the data."""
        return (self.origin, self.target) if self.outward else (self.target, self.origin)


def _goes_out(action: str, rule: Rule) -> bool:
    """Returns whether data flow outward: a flip offers publishers and requests data for subscribers, a pull vice versa.

    Service requests flow to the server.
    """
    offers = rule.kind not in (Kind.SUBSCRIBER, Kind.SERVICE, Kind.ACTION_SERVER)
    return offers == (action == "flip")


def arrows(members: Iterable[Member]) -> list[Arrow]:
    """Returns the network's arrows: one for each action, pair of gateways and direction of data."""
    members = sorted(members, key=lambda member: member.name)
    names = [member.name for member in members]
    found: dict[tuple[str, str, str, bool, bool], list[str]] = {}
    for member in members:
        for action, rules in (("flip", member.flips), ("pull", member.pulls)):
            for remote in rules:
                others = [
                    name
                    for name in names
                    if name != member.name and gateway_matches(remote.gateway, name)
                ]
                for target in others or [remote.gateway]:
                    key = (action, member.name, target, not others, _goes_out(action, remote.rule))
                    found.setdefault(key, []).append(str(remote.rule))
    return [Arrow(*key, tuple(labels)) for key, labels in found.items()]


def text(hub: str, members: Iterable[Member]) -> str:
    """Returns the network as indented lines."""
    members = sorted(members, key=lambda member: member.name)
    lines = [f"hub {hub or '(none)'}"]
    drawn = arrows(members)
    for member in members:
        lines.append(f"  {base_name(member.name)}" + ("" if member.alive else "  (not heard of)"))
        lines += [f"    advertises {rule}" for rule in member.advertised]
        for arrow in (one for one in drawn if one.origin == member.name):
            sign, missing = (
                ("-->" if arrow.outward else "<--"),
                "  (no such gateway)" if arrow.missing else "",
            )
            lines.append(f"    {arrow.action} {sign} {base_name(arrow.target)}{missing}")
            lines += [f"      {label}" for label in arrow.labels]
    return "\n".join(lines)


def dot(hub: str, members: Iterable[Member]) -> str:
    """Returns the network as a Graphviz graph with a legend: flips purple, pulls and advertisements green.

    Arrows point in the direction of data flow.
    """
    members = sorted(members, key=lambda member: member.name)
    lines = ["digraph gateways {", "  rankdir=LR; node [shape=box, style=rounded];"]
    lines.append(f"  {_quoted('hub')} [label={_quoted(hub or 'no hub')}, shape=ellipse];")
    for member in members:
        style = "" if member.alive else ", color=gray, fontcolor=gray"
        lines.append(f"  {_quoted(member.name)} [label={_quoted(base_name(member.name))}{style}];")
        label = _label([str(rule) for rule in member.advertised])
        colour = PULL_COLOUR if member.advertised else "gray"
        lines.append(
            f"  {_quoted(member.name)} -> {_quoted('hub')} [color={colour}, label={label}];"
        )
    for arrow in arrows(members):
        colour = FLIP_COLOUR if arrow.action == "flip" else PULL_COLOUR
        style = ", style=dashed" if arrow.missing else ""
        ends = " -> ".join(map(_quoted, arrow.ends))
        lines.append(
            f"  {ends} [color={colour}, fontcolor={colour}, label={_label(arrow.labels)}{style}];"
        )
    return "\n".join([*lines, *_LEGEND, "}"])


def _label(labels: Iterable[str]) -> str:
    labels = list(labels)
    shown = labels[:LABEL_LINES]
    if len(labels) > len(shown):
        shown.append(f"and {len(labels) - len(shown)} more")
    return _quoted("\n".join(shown))


def _quoted(label: str) -> str:
    body = label.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{body}"'
