"""From rules, local connections and other gateways to links, letters and rule states: one pure function.

Data flows from the gateway that has the publisher to the one that has the subscriber, and both must agree:

========================  =========================================  ======================================
rule of gateway R         R does                                     the other gateway does
========================  =========================================  ======================================
flip of a publisher       offers and exports it                      imports it, unless firewalled
flip of a subscriber      wants the topic, imports what is offered   offers and exports, unless firewalled
pull of a publisher       wants and imports what is advertised       exports what it advertises
pull of a subscriber      offers and exports its own publishers      imports for the subscriber it advertises
========================  =========================================  ======================================

Offers, wants and the replies to them travel as letters through the hub.
"""

import dataclasses
import re
from collections.abc import Callable, Iterable, Iterator

from rocon_gateway.core import verdict
from rocon_gateway.core.connection import ANY, Address, Export, Import, Key
from rocon_gateway.core.record import EMPTY, Letter, Offer, Purpose, Reply, Want
from rocon_gateway.core.rule import (
    ALL,
    CARRIED,
    Connection,
    Kind,
    RemoteRule,
    Rule,
    absolute_name,
    blacklisting,
    gateway_matches,
    is_literal,
    rule_matches,
)
from rocon_gateway.core.situation import Flipped, Outcome, Remote, RuleState, Situation, State, Verdict

Judge = Callable[[], Verdict]
"""Tells how a connection does, once the whole set of imports is known."""

_REFUSALS = (State.FIREWALLED, State.BLACKLISTED, State.REFUSED)


def reconcile(situation: Situation) -> Outcome:
    """Returns what shall be connected in `situation`, what to write to whom, and how each rule does.

    A pure function: the same situation gives the same outcome, so that applying it again changes nothing.
    """
    return _Reconciler(situation).outcome()


class _Reconciler:
    """The working state of one `reconcile`."""

    def __init__(self, situation: Situation) -> None:
        self.situation = situation
        self.book = situation.book
        self.name = situation.book.name
        self.publishers = sorted(one for one in situation.local if one.kind == Kind.PUBLISHER)
        self.types = {one.name: one.type for one in situation.local if one.type != ANY}
        self.exports: dict[Key, Export] = {}
        self.imports: dict[Key, Import] = {}
        self.nodes: dict[Key, set[str]] = {}
        self.proxies: dict[tuple[str, str], Key] = {}
        self.offers: dict[str, dict[Offer, None]] = {}
        self.wants: dict[str, dict[Want, None]] = {}
        self.replies: dict[str, dict[Reply, None]] = {}
        self.flipped: dict[Flipped, None] = {}
        self.flipped_in: dict[Flipped, None] = {}
        self.pulled: dict[Flipped, None] = {}
        # Verdicts wait for all imports: which nodes one allows is known only when all rules have had their say.
        self.pending: list[tuple[str, str, Rule, Judge]] = []
        self.pending_replies: list[tuple[str, Callable[[], Reply]]] = []

    def outcome(self) -> Outcome:
        advertised = self._advertise()
        for remote in self.book.flips.rules:
            self._towards("flip", remote, self._flip)
        for remote in self.book.pulls.rules:
            self._towards("pull", remote, self._pull)
        for gateway, other in self.situation.remotes.items():
            self._take_letter(gateway, other, advertised)
        for gateway, reply in self.pending_replies:
            self.replies.setdefault(gateway, {})[reply()] = None
        return Outcome(
            advertised=tuple(advertised),
            letters=self._letters(),
            exports=frozenset(self.exports.values()),
            imports=frozenset(self._import_for(key) for key in self.imports),
            states=tuple(RuleState(action, gateway, rule, judge()) for action, gateway, rule, judge in self.pending),
            flipped=tuple(self.flipped),
            flipped_in=tuple(self.flipped_in),
            pulled=tuple(self.pulled),
        )

    def _letters(self) -> dict[str, Letter]:
        letters = {
            gateway: Letter(
                tuple(sorted(self.offers.get(gateway, ()))),
                tuple(sorted(self.wants.get(gateway, ()))),
                tuple(sorted(self.replies.get(gateway, ()))),
            )
            for gateway in {*self.offers, *self.wants, *self.replies}
        }
        return {gateway: letter for gateway, letter in letters.items() if letter != EMPTY}

    # Advertisements

    def _advertise(self) -> list[Connection]:
        found: dict[Connection, None] = {}
        for rule in self.book.advertisements.rules:
            allowed, barred = self._sorted_out(rule, self.book.advertisements.blacklist)
            found.update(dict.fromkeys(allowed))
            self._judge("advertise", "", rule, self._advertised_verdict(rule, allowed, barred))
        return list(found)

    def _advertised_verdict(self, rule: Rule, allowed: list[Connection], barred: list[Verdict]) -> Verdict:
        if rule.kind not in CARRIED:
            return verdict.NOT_CARRIED
        if allowed:
            return Verdict(State.ACTIVE)
        return verdict.best(barred, verdict.no_local(rule, self.name, self.situation.local))

    def _sorted_out(self, rule: Rule, excluded: Iterable[Rule]) -> tuple[list[Connection], list[Verdict]]:
        """Returns the local connections that `rule` means, and a verdict on each that a blacklist keeps here."""
        if rule.kind not in CARRIED:
            return [], []
        allowed, barred = [], []
        for connection in sorted(one for one in self.situation.local if rule_matches(rule, one, self.name)):
            barrier = blacklisting((*self.book.blacklist, *excluded), connection)
            if barrier:
                barred.append(verdict.blacklisted(barrier, connection))
            else:
                allowed.append(connection)
        return allowed, barred

    # Our flips and pulls

    def _towards(self, action: str, remote: RemoteRule, act: Callable[..., Iterator[Judge]]) -> None:
        """Does one rule towards every gateway that it matches, and keeps how to judge it."""
        if remote.rule.kind not in CARRIED:
            self._judge(action, remote.gateway, remote.rule, verdict.NOT_CARRIED)
            return
        judges: list[Judge] = []
        for gateway in self._targets(remote.gateway):
            other = self.situation.remotes.get(gateway)
            if other is not None:
                judges.extend(act(remote, gateway, other))
        otherwise = self._no_target(remote.gateway)
        self.pending.append(
            (action, remote.gateway, remote.rule, lambda: verdict.best([judge() for judge in judges], otherwise))
        )

    def _targets(self, pattern: str) -> list[str]:
        return sorted(name for name in self.situation.names if name != self.name and gateway_matches(pattern, name))

    def _no_target(self, pattern: str) -> Verdict:
        if self._targets(pattern):
            return verdict.NO_ANSWER
        if not self.situation.connected:
            return verdict.NO_HUB
        return verdict.no_gateway(pattern, self.situation.names - {self.name})

    def _flip(self, remote: RemoteRule, gateway: str, other: Remote) -> Iterator[Judge]:
        rule = remote.rule
        allowed, barred = self._sorted_out(rule, self.book.flips.excluded(remote))
        for one in barred:
            yield _always(one)
        if barred and not allowed:
            return
        if rule.kind == Kind.PUBLISHER:
            yield from self._flip_publishers(rule, gateway, other, allowed)
        else:
            yield from self._flip_subscribers(rule, gateway, other, allowed)

    def _flip_publishers(self, rule: Rule, gateway: str, other: Remote, allowed: list[Connection]) -> Iterator[Judge]:
        if not allowed:
            yield _always(verdict.no_local(rule, self.name, self.situation.local))
        for connection in allowed:
            self._offer(gateway, connection, Purpose.FLIP)
            answer = _reply(other, Kind.PUBLISHER, connection.name, connection.node)
            self._flipped_to(gateway, other, connection, answer)
            yield _always(_judged(answer, other, gateway))

    def _flip_subscribers(self, rule: Rule, gateway: str, other: Remote, allowed: list[Connection]) -> Iterator[Judge]:
        topics = {connection.name for connection in allowed}
        if is_literal(rule.name) and not self._own_barrier(rule):
            # Known without any subscriber: the topic is there when one comes.
            topics |= {absolute_name(rule.name)} if rule.name.startswith("/") or not topics else set()
        if not topics:
            yield _always(verdict.no_local(rule, self.name, self.situation.local))
        for topic in sorted(topics):
            self._letter_part(self.wants, gateway, Want(topic, rule.node, Purpose.FLIP))
            answer = _reply(other, Kind.SUBSCRIBER, topic, rule.node)
            for connection in (one for one in allowed if one.name == topic):
                self._flipped_to(gateway, other, connection, answer)
            yield from self._import_answers(gateway, other, topic, rule.node, answer)

    def _own_barrier(self, rule: Rule) -> Rule | None:
        return blacklisting(self.book.blacklist, Connection(rule.kind, absolute_name(rule.name), ANY, rule.node))

    def _import_answers(
        self, gateway: str, other: Remote, topic: str, nodes: str, answer: Reply | None
    ) -> Iterator[Judge]:
        offers = [one for one in other.letter.offers if one.purpose == Purpose.ANSWER and one.topic == topic]
        for offer in offers:
            yield self._import(gateway, other, Connection(Kind.PUBLISHER, topic, offer.type, offer.node), nodes)
        if not offers:
            yield _always(_judged(answer, other, gateway))

    def _flipped_to(self, gateway: str, other: Remote, connection: Connection, answer: Reply | None) -> None:
        if other.record.firewall or (answer and answer.state.startswith(_REFUSALS)):
            status = "blocked"
        else:
            status = "accepted" if answer else "pending"
        self.flipped[Flipped(gateway, connection, status)] = None

    def _pull(self, remote: RemoteRule, gateway: str, other: Remote) -> Iterator[Judge]:
        rule = remote.rule
        offered = [one for one in other.record.advertisements if rule_matches(rule, one, self.name)]
        # Pulling one topic by name is consent enough; pulling everything leaves out what we blacklist.
        excluded = (*self.book.blacklist, *self.book.pulls.excluded(remote)) if rule.name == ALL else ()
        for connection in offered:
            barrier = blacklisting(excluded, connection)
            if barrier:
                said = verdict.blacklisted(barrier, connection)
                yield _always(said)
            else:
                self.pulled[Flipped(gateway, connection)] = None
                yield from self._pull_connection(gateway, other, connection)
        if not offered:
            names = {one.name for one in other.record.advertisements if one.kind == rule.kind}
            yield _always(verdict.no_topic(rule.name, names, f"advertised by {gateway}"))

    def _pull_connection(self, gateway: str, other: Remote, connection: Connection) -> Iterator[Judge]:
        if connection.kind == Kind.PUBLISHER:
            self._letter_part(self.wants, gateway, Want(connection.name, connection.node, Purpose.PULL))
            yield self._import(gateway, other, connection, "")
            return
        own = [one for one in self.publishers if one.name == connection.name and not self._barred(one)]
        for publisher in own:
            self._offer(gateway, publisher, Purpose.PULL, connection.node)
            answer = _reply(other, Kind.PUBLISHER, publisher.name, publisher.node)
            yield _always(_judged(answer, None, gateway))
        if not own:
            yield _always(Verdict(State.NO_PUBLISHER, f"nobody here publishes {connection.name}"))

    # What the other gateways ask of us

    def _take_letter(self, gateway: str, other: Remote, advertised: list[Connection]) -> None:
        interface = {(one.kind, one.name, one.node): one for one in advertised}
        for offer in other.letter.offers:
            if offer.purpose == Purpose.FLIP:
                self._take_flipped_publisher(gateway, other, offer)
            elif offer.purpose == Purpose.PULL and (Kind.SUBSCRIBER, offer.topic, offer.to_node) in interface:
                self._take_offer(gateway, other, offer, re.escape(offer.to_node))
        for want in other.letter.wants:
            if want.purpose == Purpose.FLIP:
                self._take_flipped_subscriber(gateway, want)
            elif (Kind.PUBLISHER, want.topic, want.node) in interface:
                self._export(gateway, interface[Kind.PUBLISHER, want.topic, want.node])

    def _take_flipped_publisher(self, gateway: str, other: Remote, offer: Offer) -> None:
        if self.situation.firewall:
            self._reply(gateway, Reply(Kind.PUBLISHER, offer.topic, offer.node, State.FIREWALLED))
            return
        self.flipped_in[Flipped(gateway, Connection(Kind.PUBLISHER, offer.topic, offer.type, offer.node))] = None
        self._take_offer(gateway, other, offer, "")

    def _take_offer(self, gateway: str, other: Remote, offer: Offer, nodes: str) -> None:
        judge = self._import(gateway, other, Connection(Kind.PUBLISHER, offer.topic, offer.type, offer.node), nodes)

        def reply() -> Reply:
            said = judge()
            return Reply(Kind.PUBLISHER, offer.topic, offer.node, said.state, said.reason)

        self.pending_replies.append((gateway, reply))

    def _take_flipped_subscriber(self, gateway: str, want: Want) -> None:
        if self.situation.firewall:
            self._reply(gateway, Reply(Kind.SUBSCRIBER, want.topic, want.node, State.FIREWALLED))
            return
        self.flipped_in[Flipped(gateway, Connection(Kind.SUBSCRIBER, want.topic, ANY, want.node))] = None
        mine = [one for one in self.publishers if one.name == want.topic]
        allowed = [one for one in mine if not self._barred(one)]
        for connection in allowed:
            self._offer(gateway, connection, Purpose.ANSWER)
        if allowed:
            said = Verdict(State.ACTIVE)
        elif mine:
            barrier = self._barred(mine[0])
            assert barrier is not None
            said = verdict.blacklisted(barrier, mine[0])
        else:
            said = verdict.no_publisher(want.topic, self.situation.local)
        self._reply(gateway, Reply(Kind.SUBSCRIBER, want.topic, want.node, said.state, said.reason))

    # The parts of the outcome

    def _barred(self, connection: Connection) -> Rule | None:
        return blacklisting(self.book.blacklist, connection)

    def _offer(self, gateway: str, connection: Connection, purpose: Purpose, to_node: str = "") -> None:
        offer = Offer(connection.name, connection.type, connection.node, purpose, to_node)
        self._letter_part(self.offers, gateway, offer)
        self._export(gateway, connection)

    def _export(self, gateway: str, connection: Connection) -> None:
        export = Export(connection.name, connection.type, connection.node, gateway)
        self.exports.setdefault(export.key, export)

    def _import(self, gateway: str, other: Remote, connection: Connection, nodes: str) -> Judge:
        """Imports a remote publisher for the nodes that match (empty: any), and returns how to judge that."""
        here = self.types.get(connection.name, ANY)
        if ANY not in (here, connection.type) and here != connection.type:
            at = {self.name: here, gateway: connection.type}
            return _always(verdict.mismatch(connection.name, at))
        address = Address(other.record.host, other.record.port)
        wanted = Import(connection.name, connection.type, ANY, gateway, connection.node, address)
        clash = self._clash(wanted)
        if clash:
            return _always(Verdict(State.REFUSED, clash))
        self.imports[wanted.key] = wanted
        self.nodes.setdefault(wanted.key, set()).add(nodes)
        return lambda: verdict.from_link(self._import_for(wanted.key), self.situation.links)

    def _clash(self, wanted: Import) -> str:
        """Returns why the proxy's name cannot be had; a node that registers under another's name would end that one."""
        if any(one.node == wanted.proxy for one in self.situation.local):
            return f"a node {wanted.proxy} is here already"
        key = self.proxies.setdefault((wanted.topic, wanted.proxy), wanted.key)
        return "" if key == wanted.key else f"{wanted.proxy} stands for a node of gateway {key.gateway} already"

    def _import_for(self, key: Key) -> Import:
        """Returns one import for the nodes of all rules that ask for it."""
        nodes = self.nodes[key]
        if "" in nodes:
            return self.imports[key]
        # Sorted, so that the order of the rules does not change what the relay is asked for.
        pattern = nodes.copy().pop() if len(nodes) == 1 else "|".join(f"(?:{one})" for one in sorted(nodes))
        return dataclasses.replace(self.imports[key], allowed_nodes=pattern)

    def _reply(self, gateway: str, reply: Reply) -> None:
        self._letter_part(self.replies, gateway, reply)

    def _letter_part(self, parts: dict, gateway: str, part: Offer | Want | Reply) -> None:  # type: ignore[type-arg]
        parts.setdefault(gateway, {})[part] = None

    def _judge(self, action: str, gateway: str, rule: Rule, said: Verdict) -> None:
        self.pending.append((action, gateway, rule, _always(said)))


def _always(said: Verdict) -> Judge:
    return lambda: said


def _reply(other: Remote, kind: Kind, topic: str, node: str) -> Reply | None:
    return next((one for one in other.letter.replies if (one.kind, one.topic, one.node) == (kind, topic, node)), None)


def _judged(answer: Reply | None, flipped_to: Remote | None, gateway: str) -> Verdict:
    """Returns what a reply says; a firewall needs no reply to be known."""
    if flipped_to is not None and flipped_to.record.firewall:
        return Verdict(State.FIREWALLED, f"{gateway} accepts no flips")
    if answer is None:
        return verdict.NO_ANSWER
    return Verdict(answer.state, answer.reason)
