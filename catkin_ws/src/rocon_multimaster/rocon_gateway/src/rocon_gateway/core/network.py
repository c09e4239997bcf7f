"""The network of a hub as a picture: who advertises, pulls and flips what, with whom."""

from collections.abc import Iterable
from dataclasses import dataclass

from rocon_gateway.core.matching import base_name, gateway_matches
from rocon_hub_protocol.core.rule import Kind, RemoteRule, Rule

FLIP_COLOUR = "purple"
PULL_COLOUR = "green4"
"""As in the figure of the tutorial: flips are direct, what is advertised may be pulled by all."""

_LEGEND = (
    "  subgraph cluster_legend {",
    '    label="arrows point where data go"; style=rounded; color=gray; node [shape=point, width=0.01, label=""];',
    f'    legend_1 -> legend_2 [color={FLIP_COLOUR}, fontcolor={FLIP_COLOUR}, label="flipped"];',
    f'    legend_3 -> legend_4 [color={PULL_COLOUR}, fontcolor={PULL_COLOUR}, label="pulled, or advertised"];',
    f'    legend_5 -> legend_6 [color={FLIP_COLOUR}, style=dashed, label="no such gateway"];',
    "  }",
)

LABEL_LINES = 8
"""An arrow names so many topics and counts the others."""


@dataclass(frozen=True)
class Member:
    """A gateway of the network."""

    name: str  #: its unique name
    advertised: tuple[Rule, ...] = ()  #: what others may pull
    flips: tuple[RemoteRule, ...] = ()  #: its flip rules
    pulls: tuple[RemoteRule, ...] = ()  #: its pull rules
    alive: bool = True  #: whether the hub hears of it


@dataclass(frozen=True)
class Arrow:
    """Rules of one gateway towards another."""

    action: str  #: "flip" or "pull"
    origin: str  #: the gateway whose rules these are
    target: str  #: the other one's unique name, or the rule's pattern if it means none
    missing: bool  #: whether it means none
    outward: bool  #: whether data, or requests to a service, go from the origin to the target
    labels: tuple[str, ...]  #: the rules, for people

    @property
    def ends(self) -> tuple[str, str]:
        """Where its data come from and go to."""
        return (self.origin, self.target) if self.outward else (self.target, self.origin)


def _goes_out(action: str, rule: Rule) -> bool:
    """Tells which way data go: a flip offers publishers and asks for subscribers, a pull the other way round.

    Requests to a service go to its server.
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
                others = [name for name in names if name != member.name and gateway_matches(remote.gateway, name)]
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
            sign, missing = ("-->" if arrow.outward else "<--"), "  (no such gateway)" if arrow.missing else ""
            lines.append(f"    {arrow.action} {sign} {base_name(arrow.target)}{missing}")
            lines += [f"      {label}" for label in arrow.labels]
    return "\n".join(lines)


def dot(hub: str, members: Iterable[Member]) -> str:
    """Returns the network in Graphviz' language, with a legend: flips purple, pulls and advertisements green.

    Arrows point where data go.
    """
    members = sorted(members, key=lambda member: member.name)
    lines = ["digraph gateways {", "  rankdir=LR; node [shape=box, style=rounded];"]
    lines.append(f"  {_quoted('hub')} [label={_quoted(hub or 'no hub')}, shape=ellipse];")
    for member in members:
        style = "" if member.alive else ", color=gray, fontcolor=gray"
        lines.append(f"  {_quoted(member.name)} [label={_quoted(base_name(member.name))}{style}];")
        label = _label([str(rule) for rule in member.advertised])
        colour = PULL_COLOUR if member.advertised else "gray"
        lines.append(f"  {_quoted(member.name)} -> {_quoted('hub')} [color={colour}, label={label}];")
    for arrow in arrows(members):
        colour = FLIP_COLOUR if arrow.action == "flip" else PULL_COLOUR
        style = ", style=dashed" if arrow.missing else ""
        ends = " -> ".join(map(_quoted, arrow.ends))
        lines.append(f"  {ends} [color={colour}, fontcolor={colour}, label={_label(arrow.labels)}{style}];")
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
