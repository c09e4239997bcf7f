"""States of rules with their reasons: chooses the best of several, and suggests similar names for unknown ones."""

import functools
from collections.abc import Callable, Collection, Iterable, Mapping

from rocon_gateway.rules.matching import absolute_name, base_name, is_literal, name_matches
from rocon_gateway.rules.situation import WORKING, State, Verdict
from rocon_gateway.rules.spelling import spelling_of
from rocon_hub_protocol.rule import LONGEST_NAME, Connection, Kind, RemoteRule, Rule
from rocon_relay.connection import Import, LinkState, LinkStatus

_ORDER = (
    State.ACTIVE,
    State.RATE_LIMITED,
    State.MTU,
    State.TYPE_MISMATCH,
    State.UNREACHABLE,
    State.REFUSED,
    State.FIREWALLED,
    State.PENDING,
    State.NO_PUBLISHER,
    State.NO_SERVER,
    State.BLACKLISTED,
    State.NO_TOPIC,
    State.NO_SERVICE,
    State.NO_ACTION,
    State.NO_PARAMETER,
    State.NO_GATEWAY,
)
_RANKS = {str(state): rank for rank, state in enumerate(_ORDER)}

_MISSING = {
    Kind.PUBLISHER: (State.NO_TOPIC, "topic"),
    Kind.SUBSCRIBER: (State.NO_TOPIC, "topic"),
    Kind.SERVICE: (State.NO_SERVICE, "service"),
    Kind.ACTION_CLIENT: (State.NO_ACTION, "action"),
    Kind.ACTION_SERVER: (State.NO_ACTION, "action"),
    Kind.PARAMETER: (State.NO_PARAMETER, "parameter"),
}
_VERBS = {
    Kind.PUBLISHER: "published by",
    Kind.SUBSCRIBER: "subscribed by",
    Kind.SERVICE: "served by",
    Kind.ACTION_CLIENT: "used by",
    Kind.ACTION_SERVER: "served by",
}

UNCOVERED = "not covered by a rule; to cover every node:"
"""Marks, in the reason of a flip for one node, the text before the suggested command."""

NO_HUB = Verdict(State.PENDING, "waiting for a hub")
NO_ANSWER = Verdict(State.PENDING, "waiting for the other gateway's answer")


def best(verdicts: Iterable[Verdict], otherwise: Verdict) -> Verdict:
    """Returns the most relevant verdict on whether data can flow; `otherwise` if there are none.

    A state begins with one of `State`'s words (`blacklisted by RULE`); among equals, the first wins.
    """
    return min(verdicts, key=_rank, default=otherwise)


def _rank(verdict: Verdict) -> int:
    return next(
        (rank for word, rank in _RANKS.items() if verdict.state.startswith(word)), len(_RANKS)
    )


def blacklisted(barrier: Rule, connection: Connection) -> Verdict:
    """Returns the verdict on a connection blacklisted by `barrier`."""
    return Verdict(
        f"{State.BLACKLISTED} by {barrier}", f"{connection.name} of {connection.node or 'any node'}"
    )


def foreign(namespace: str, gateway: str) -> Verdict:
    """Returns the verdict on a connection from another robot's namespace that `gateway` reaches only by a pattern."""
    return Verdict(
        State.REFUSED,
        f"/{namespace} is not the robot of {gateway}: a rule that spells it out brings it",
    )


def foreign_node(node: str, gateway: str) -> Verdict:
    """Returns the verdict on a publisher excluded as another robot's node by an option of `gateway`."""
    return Verdict(
        State.REFUSED,
        f"{node} is another robot's node, and rule_options of {gateway} leave those out",
    )


def from_link(wanted: Import, links: Mapping[Import, LinkStatus]) -> Verdict:
    """Returns the verdict on an import; pending while the relay does not know it yet."""
    status = links.get(wanted, LinkStatus(LinkState.PENDING))
    return Verdict(str(status.state), status.reason)


def of_action(action: Connection, at: str, said: Iterable[tuple[Kind, Verdict]]) -> Verdict:
    """Returns the verdict on an action from those of its topics: active if all are, else the most relevant one.

    A topic that does not work is more relevant than one that works with a limit.

    Args:
        action: the action.
        at: where the other side of the action should be, for the reason text.
        said: for each topic, whether the action's node publishes or subscribes to it, and its verdict.
    """
    wrong = []
    for kind, one in said:
        nobody = kind == Kind.SUBSCRIBER and one.state in (State.NO_TOPIC, State.NO_PUBLISHER)
        if nobody and action.kind == Kind.ACTION_CLIENT:
            wrong.append(Verdict(State.NO_ACTION, f"no server of {action.name} {at}"))
        elif not nobody and one.state != State.ACTIVE:  # a server without clients is fine
            wrong.append(one)
    broken = [one for one in wrong if str(one.state) not in WORKING]
    return best(broken or wrong, Verdict(State.ACTIVE))


@functools.lru_cache(maxsize=512)
def no_gateway(pattern: str, names: frozenset[str]) -> Verdict:
    """Returns the verdict on a rule whose gateway is not on the hub, suggesting similar names that are."""
    return Verdict(State.NO_GATEWAY, _nearest(pattern, _base_names(names), "on the hub", "gateway"))


@functools.lru_cache(maxsize=4)
def _base_names(names: frozenset[str]) -> frozenset[str]:
    return frozenset(map(base_name, names))


def no_local(rule: Rule, own_gateway: str, local: Iterable[Connection]) -> Verdict:
    """Returns the verdict on a rule without matching local connection; the reason tells if name or node is wrong."""
    same_kind = [one for one in local if one.kind == rule.kind]
    nodes = sorted(
        {one.node for one in same_kind if name_matches(rule.name, one.name, own_gateway)}
    )
    if nodes and rule.node:
        here = f"here it is {_VERBS[rule.kind]} {', '.join(nodes)}, not {rule.node}"
        return Verdict(State.NO_SERVER if rule.kind == Kind.SERVICE else State.NO_PUBLISHER, here)
    return nothing(rule.kind, rule.name, {one.name for one in same_kind}, "here")


def nothing(kind: Kind, pattern: str, names: Collection[str], where: str) -> Verdict:
    """Returns the verdict on a rule whose topic, service or action does not exist, suggesting similar names."""
    name = absolute_name(pattern) if is_literal(pattern) else pattern
    state, what = _MISSING[kind]
    return Verdict(state, _nearest(name, names, where, what))


def for_node(
    judge: Callable[[], Verdict], topic: str, rule: RemoteRule, listens: bool, others: list[str]
) -> Verdict:
    """Returns the verdict on a topic that is flipped for one node only.

    Args:
        judge: returns the verdict on the topic.
        topic: its name.
        rule: the flip, which names the node.
        listens: whether that node subscribes to the topic.
        others: other subscribing nodes that no flip covers.
    """
    said = judge()
    if str(said.state) not in WORKING or (listens and not others):
        return said
    reason = (
        f"only for {rule.rule.node}"
        if listens
        else f"for {rule.rule.node}, which does not listen yet"
    )
    if others:
        cure = f"rosrun rocon_gateway flip {rule.gateway} {topic} -t subscriber"
        reason += f"; here it is also subscribed by {', '.join(others)}, {UNCOVERED} '{cure}'"
    return Verdict(said.state, "; ".join(filter(None, (said.reason, reason))))


def no_publisher(topic: str, local: Iterable[Connection]) -> Verdict:
    """Returns our answer to a gateway that wants our publishers of `topic` when there are none."""
    local = list(local)
    if any(one.name == topic for one in local):
        return Verdict(State.NO_PUBLISHER, f"{topic} is subscribed there, but not published")
    return nothing(
        Kind.PUBLISHER, topic, {one.name for one in local if one.kind == Kind.PUBLISHER}, "there"
    )


def mismatch(topic: str, types: Mapping[str, str]) -> Verdict:
    """Returns the verdict on a topic whose type differs between gateways."""
    return Verdict(
        State.TYPE_MISMATCH,
        f"{topic} is " + " and ".join(f"{t} at {at}" for at, t in types.items()),
    )


def _nearest(name: str, known: Collection[str], where: str, what: str) -> str:
    is_name = len(name) <= LONGEST_NAME
    near = spelling_of(name, where).nearest(frozenset(known)) if is_name else []
    if near:
        return f"nearest {where}: {', '.join(near)}"
    return f"no {what} {where} has a similar name" if known else f"there is no {what} {where}"
