"""Words for rule states: the best of several, and what to say when a name does not exist."""

import difflib
from collections.abc import Collection, Iterable, Mapping

from rocon_gateway.core.connection import Import, LinkState, LinkStatus
from rocon_gateway.core.rule import (
    Connection,
    Kind,
    Rule,
    absolute_name,
    base_name,
    is_literal,
    name_matches,
)
from rocon_gateway.core.situation import State, Verdict

_ORDER = (
    State.ACTIVE,
    State.TYPE_MISMATCH,
    State.UNREACHABLE,
    State.REFUSED,
    State.FIREWALLED,
    State.PENDING,
    State.NO_PUBLISHER,
    State.BLACKLISTED,
    State.NO_TOPIC,
    State.NO_GATEWAY,
    State.NOT_CARRIED,
)
_RANKS = {str(state): rank for rank, state in enumerate(_ORDER)}

NOT_CARRIED = Verdict(State.NOT_CARRIED, "links carry topics; services and actions are kept as rules and not carried")
NO_HUB = Verdict(State.PENDING, "waiting for a hub")
NO_ANSWER = Verdict(State.PENDING, "waiting for the other gateway's answer")


def best(verdicts: Iterable[Verdict], otherwise: Verdict) -> Verdict:
    """Returns the verdict that says most about whether data can flow; `otherwise` if there are none.

    A state begins with one of `State`'s words (`blacklisted by RULE`); the first of several equal ones wins.
    """
    return min(verdicts, key=_rank, default=otherwise)


def _rank(verdict: Verdict) -> int:
    return next((rank for word, rank in _RANKS.items() if verdict.state.startswith(word)), len(_RANKS))


def blacklisted(barrier: Rule, connection: Connection) -> Verdict:
    """Returns the state of what `barrier` keeps from leaving its gateway."""
    return Verdict(f"{State.BLACKLISTED} by {barrier}", f"{connection.name} of {connection.node or 'any node'}")


def from_link(wanted: Import, links: Mapping[Import, LinkStatus]) -> Verdict:
    """Returns the state of an import, pending while the relay has not heard of it."""
    status = links.get(wanted, LinkStatus(LinkState.PENDING))
    return Verdict(str(status.state), status.reason)


def no_gateway(pattern: str, names: Collection[str]) -> Verdict:
    """Returns the state of a rule whose gateway is not on the hub, with those that are and are spelt alike."""
    return Verdict(State.NO_GATEWAY, _nearest(pattern, {base_name(name) for name in names}, "on the hub", "gateway"))


def no_local(rule: Rule, own_gateway: str, local: Iterable[Connection]) -> Verdict:
    """Returns the state of a rule that no local connection matches: whether it is the topic or the node that fails."""
    same_kind = [one for one in local if one.kind == rule.kind]
    nodes = sorted({one.node for one in same_kind if name_matches(rule.name, one.name, own_gateway)})
    if nodes:
        return Verdict(State.NO_PUBLISHER, f"here it is {_verb(rule.kind)} {', '.join(nodes)}, not {rule.node}")
    return no_topic(rule.name, {one.name for one in same_kind}, "here")


def no_topic(pattern: str, names: Collection[str], where: str) -> Verdict:
    """Returns the state of a rule whose topic nobody has, with topics that are spelt alike."""
    name = absolute_name(pattern) if is_literal(pattern) else pattern
    return Verdict(State.NO_TOPIC, _nearest(name, names, where, "topic"))


def no_publisher(topic: str, local: Iterable[Connection]) -> Verdict:
    """Returns what we answer who wants our publishers of `topic` when there are none."""
    local = list(local)
    if any(one.name == topic for one in local):
        return Verdict(State.NO_PUBLISHER, f"{topic} is subscribed there, but not published")
    return no_topic(topic, {one.name for one in local if one.kind == Kind.PUBLISHER}, "there")


def mismatch(topic: str, types: Mapping[str, str]) -> Verdict:
    """Returns the state of a topic whose type is not the same at two gateways."""
    return Verdict(State.TYPE_MISMATCH, f"{topic} is " + " and ".join(f"{t} at {at}" for at, t in types.items()))


def _verb(kind: Kind) -> str:
    return "published by" if kind == Kind.PUBLISHER else "subscribed by"


def _nearest(name: str, known: Collection[str], where: str, what: str) -> str:
    near = difflib.get_close_matches(name, sorted(known), n=3)
    if near:
        return f"nearest {where}: {', '.join(near)}"
    return f"no {what} {where} has a similar name" if known else f"there is no {what} {where}"
