"""Computes links, requests and rule states from rules, local connections and other gateways, in one pure function.

Data flows from the publisher's gateway to the subscriber's gateway, and both must agree:

========================  =========================================  ======================================
rule of gateway R         R does                                     the other gateway does
========================  =========================================  ======================================
flip of a publisher       offers and exports it                      imports it, unless firewalled
flip of a subscriber      wants the topic, imports what is offered   offers and exports, unless firewalled
pull of a publisher       wants and imports what is advertised       exports what it advertises
pull of a subscriber      offers and exports its own publishers      imports for the subscriber it advertises
flip, pull of a service   as of a publisher                          as of a publisher
flip, pull of an action   as of each of its topics                   as of each of its topics
pull of a parameter       wants and copies what is advertised        lets it be read
========================  =========================================  ======================================

Offers, wants and the replies to them are exchanged as requests through the hub.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from rocon_gateway.rules import verdict
from rocon_gateway.rules.action import ACTION_KINDS, actions, parts
from rocon_gateway.rules.decision import Decision, PendingVerdict, always
from rocon_gateway.rules.matching import (
    ALL,
    absolute_name,
    asks_for,
    base_name,
    blacklisting,
    foreign_namespace,
    gateway_matches,
    gateways_meant,
    is_literal,
    rule_matches,
)
from rocon_gateway.rules.situation import (
    Flipped,
    Outcome,
    Remote,
    RuleState,
    Situation,
    State,
    Verdict,
)
from rocon_hub_protocol.record import Offer, Purpose, Reply, Want
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule
from rocon_relay.connection import ANY

_REFUSALS = (State.FIREWALLED, State.BLACKLISTED, State.REFUSED)


def reconcile(situation: Situation) -> Outcome:
    """Returns the required links, the requests to other gateways, and the state of each rule for `situation`.

    A pure function: the same situation gives the same outcome, so applying it again changes nothing.
    """
    return _Reconciler(situation).outcome()


class _Reconciler:
    """The working state of one `reconcile`."""

    def __init__(self, situation: Situation) -> None:
        self.situation = situation
        self.book = situation.book
        self.name = situation.book.name
        # Keep the same object for the same set, so that cache look-ups are fast.
        self.others = (
            situation.names if self.name not in situation.names else situation.names - {self.name}
        )
        found = actions(situation.local)
        self.local = sorted(situation.local | found)
        self.action_topics = {part for action in found for part in map(_key, parts(action))}
        self.publishers = [one for one in self.local if one.kind == Kind.PUBLISHER]
        self.decision = Decision(situation)
        self.flipped: dict[Flipped, None] = {}
        self.flipped_in: dict[Flipped, None] = {}
        self.pulled: dict[Flipped, None] = {}
        # Verdicts are evaluated last: the allowed nodes of an import are known only after all rules were processed.
        self.pending: list[tuple[str, str, Rule, PendingVerdict]] = []
        self.pending_replies: list[tuple[str, Callable[[], Reply]]] = []

    def outcome(self) -> Outcome:
        advertised = self._advertise()
        for remote in self.book.flips.rules:
            self._towards("flip", remote, self._flip)
        for remote in self.book.pulls.rules:
            self._towards("pull", remote, self._pull)
        interface = {_key(part): part for one in advertised for part in (one, *parts(one))}
        for gateway, other in self.situation.remotes.items():
            self._take_request(gateway, other, interface)
        for gateway, reply in self.pending_replies:
            self.decision.reply(gateway, reply())
        return Outcome(
            advertised=tuple(advertised),
            requests=self.decision.requests(),
            exports=self.decision.exports(),
            imports=self.decision.imports(),
            states=tuple(
                RuleState(action, gateway, rule, judge())
                for action, gateway, rule, judge in self.pending
            ),
            flipped=tuple(self.flipped),
            flipped_in=tuple(self.flipped_in),
            pulled=tuple(self.pulled),
            barring=self.decision.barring,
        )

    # Advertisements

    def _advertise(self) -> list[Connection]:
        found: dict[Connection, None] = {}
        for rule in self.book.advertisements.rules:
            allowed, barred = self._sorted_out(rule, self.book.advertisements.blacklist)
            if rule.kind == Kind.PARAMETER:  # its existence is only checked when it is read
                allowed.append(Connection(rule.kind, absolute_name(rule.name), ANY, ""))
            found.update(dict.fromkeys(allowed))
            said = Verdict(State.ACTIVE) if allowed else verdict.best(barred, self._no_local(rule))
            self.pending.append(("advertise", "", rule, always(said)))
        return list(found)

    def _no_local(self, rule: Rule) -> Verdict:
        return verdict.no_local(rule, self.name, self.local)

    def _sorted_out(
        self, rule: Rule, excluded: Iterable[Rule]
    ) -> tuple[list[Connection], list[Verdict]]:
        """Returns the local connections that `rule` matches, and a verdict on each that a blacklist excludes.

        A `.*` rule for a kind skips the topics of actions, because these are handled as actions.
        """
        allowed, barred = [], []
        for connection in self.local:
            if not rule_matches(rule, connection, self.name):
                continue
            if rule.name == ALL and _key(connection) in self.action_topics:
                continue
            barrier = self._barred(connection, *excluded)
            if barrier:
                barred.append(verdict.blacklisted(barrier, connection))
            else:
                allowed.append(connection)
        return allowed, barred

    def _barred(self, connection: Connection, *excluded: Rule) -> Rule | None:
        return _barrier((*self.book.blacklist, *excluded), connection)

    # Our flips and pulls

    def _towards(
        self, action: str, remote: RemoteRule, act: Callable[..., Iterator[PendingVerdict]]
    ) -> None:
        """Applies one rule to every gateway that it matches, and stores its pending verdict."""
        judges: list[PendingVerdict] = []
        targets = gateways_meant(remote.gateway, self.others)
        for gateway in targets:
            other = self.situation.remotes.get(gateway)
            if other is not None:
                judges.extend(act(remote, gateway, other))
        otherwise = verdict.NO_ANSWER if targets else self._no_target(remote.gateway)
        self.pending.append(
            (
                action,
                remote.gateway,
                remote.rule,
                lambda: verdict.best([judge() for judge in judges], otherwise),
            )
        )

    def _no_target(self, pattern: str) -> Verdict:
        return (
            verdict.no_gateway(pattern, self.others) if self.situation.connected else verdict.NO_HUB
        )

    def _flip(self, remote: RemoteRule, gateway: str, other: Remote) -> Iterator[PendingVerdict]:
        rule = remote.rule
        allowed, barred = self._sorted_out(rule, self.book.flips.excluded(remote))
        yield from map(always, barred)
        if barred and not allowed:
            return
        if rule.kind == Kind.SUBSCRIBER:
            yield from self._flip_subscribers(rule, gateway, other, allowed)
        elif not allowed:
            yield always(self._no_local(rule))
        elif rule.kind in ACTION_KINDS:
            for action in allowed:
                namespace = self._unasked(rule, other.record.namespace, action)
                foreign = always(verdict.foreign(namespace, gateway))
                yield foreign if namespace else self._flip_action(gateway, other, action)
        else:
            for connection in allowed:
                namespace = self._unasked(rule, other.record.namespace, connection)
                if namespace:
                    yield always(verdict.foreign(namespace, gateway))
                    continue
                answer = self._offered(gateway, other, connection)
                self._flipped_to(gateway, other, connection, answer)
                yield always(_judged(answer, other, gateway))

    def _flip_subscribers(
        self, rule: Rule, gateway: str, other: Remote, allowed: list[Connection]
    ) -> Iterator[PendingVerdict]:
        topics = {connection.name for connection in allowed}
        if is_literal(rule.name) and not self._own_barrier(rule):
            # A literal name works without a subscriber; the topic exists once one connects.
            topics |= (
                {absolute_name(rule.name)} if rule.name.startswith("/") or not topics else set()
            )
        if not topics:
            yield always(self._no_local(rule))
        for topic in sorted(topics):
            answer, judge = self._wanted(gateway, other, topic, rule.node)
            listening = [one for one in allowed if one.name == topic]
            for connection in listening:
                self._flipped_to(gateway, other, connection, answer)
            if rule.node:
                remote, others = (
                    RemoteRule(base_name(gateway), rule),
                    self._not_covered(gateway, topic),
                )
                judge = partial(verdict.for_node, judge, topic, remote, bool(listening), others)
            yield judge

    def _not_covered(self, gateway: str, topic: str) -> list[str]:
        """Returns the nodes that subscribe to a topic but are not covered by any flip from that gateway."""
        flips = [one.rule for one in self.book.flips.rules if gateway_matches(one.gateway, gateway)]
        subscribers = [
            one for one in self.local if one.kind == Kind.SUBSCRIBER and one.name == topic
        ]
        return sorted(
            {
                one.node
                for one in subscribers
                if not any(rule_matches(flip, one, self.name) for flip in flips)
            }
        )

    def _flip_action(self, gateway: str, other: Remote, action: Connection) -> PendingVerdict:
        answers, judges = [], []
        for part in parts(action):
            if part.kind == Kind.PUBLISHER:
                answer = self._offered(gateway, other, part)
                judge = always(_judged(answer, other, gateway))
            else:
                answer, judge = self._wanted(gateway, other, part.name, re.escape(part.node))
            answers.append(answer)
            judges.append((part.kind, judge))
        self._flipped_to(gateway, other, action, *answers)
        return _of_action(action, f"at {gateway}", judges)

    def _offered(self, gateway: str, other: Remote, connection: Connection) -> Reply | None:
        """Flips a publisher or server; returns the reply, if any."""
        purpose = Purpose.SERVICE if connection.kind == Kind.SERVICE else Purpose.FLIP
        self.decision.offer(gateway, connection, purpose)
        return _reply(other, connection.kind, connection.name, connection.node)

    def _wanted(
        self, gateway: str, other: Remote, topic: str, nodes: str
    ) -> tuple[Reply | None, PendingVerdict]:
        """Flips a topic's subscribers; returns the reply, if any, and the pending verdict."""
        self.decision.want(gateway, Want(topic, nodes, Purpose.FLIP))
        answer = _reply(other, Kind.SUBSCRIBER, topic, nodes)
        judges = [
            self.decision.import_publisher(
                gateway, other, Connection(Kind.PUBLISHER, topic, one.type, one.node), nodes
            )
            for one in other.request.offers
            if one.purpose == Purpose.ANSWER and one.topic == topic
        ]
        return answer, lambda: verdict.best(
            [one() for one in judges], _judged(answer, other, gateway)
        )

    def _own_barrier(self, rule: Rule) -> Rule | None:
        return blacklisting(
            self.book.blacklist, Connection(rule.kind, absolute_name(rule.name), ANY, rule.node)
        )

    def _flipped_to(
        self, gateway: str, other: Remote, connection: Connection, *answers: Reply | None
    ) -> None:
        if other.record.firewall or any(one and one.state.startswith(_REFUSALS) for one in answers):
            status = "blocked"
        else:
            status = "accepted" if all(answers) else "pending"
        self.flipped[Flipped(gateway, connection, status)] = None

    def _pull(self, remote: RemoteRule, gateway: str, other: Remote) -> Iterator[PendingVerdict]:
        rule = remote.rule
        offered = [one for one in other.record.advertisements if rule_matches(rule, one, self.name)]
        # A pull by name overrides our blacklist; a pull of everything respects it.
        excluded = (
            (*self.book.blacklist, *self.book.pulls.excluded(remote)) if rule.name == ALL else ()
        )
        for connection in offered:
            barrier = _barrier(excluded, connection)
            namespace = self._unasked(rule, self.situation.namespace, connection)
            if barrier:
                yield always(verdict.blacklisted(barrier, connection))
            elif namespace:
                yield always(verdict.foreign(namespace, self.name))
            elif (refused := self.decision.left_out(gateway, connection)) is not None:
                yield always(refused)
            else:
                self.pulled[Flipped(gateway, connection)] = None
                yield self._pull_connection(gateway, other, connection)
        if not offered:
            names = {one.name for one in other.record.advertisements if one.kind == rule.kind}
            yield always(verdict.nothing(rule.kind, rule.name, names, f"advertised by {gateway}"))

    def _unasked(self, rule: Rule, own: str, connection: Connection) -> str:
        """Returns the foreign robot namespace of `connection` unless `rule` spells it out; "" if there is none."""
        namespace = foreign_namespace(own, connection.name, self.situation.robots)
        return "" if asks_for(rule.name, namespace) else namespace

    def _pull_connection(
        self, gateway: str, other: Remote, connection: Connection
    ) -> PendingVerdict:
        name, node = connection.name, connection.node
        if connection.kind in ACTION_KINDS:
            judges = [
                (part.kind, self._pull_connection(gateway, other, part))
                for part in parts(connection)
            ]
            return _of_action(connection, "here", judges)
        if connection.kind == Kind.PUBLISHER:
            self.decision.want(gateway, Want(name, node, Purpose.PULL))
            return self.decision.import_publisher(gateway, other, connection, "")
        if connection.kind == Kind.SERVICE:
            self.decision.want(gateway, Want(name, node, Purpose.SERVICE))
            return self.decision.import_service(gateway, other, connection)
        if connection.kind == Kind.PARAMETER:
            self.decision.want(gateway, Want(name, node, Purpose.PARAMETER))
            return self.decision.import_parameter(gateway, other, connection)
        return self._feed(gateway, other, connection)

    def _feed(self, gateway: str, other: Remote, subscriber: Connection) -> PendingVerdict:
        """Offers our own publishers to a pulled subscriber."""
        said = []
        for publisher in self.publishers:
            if publisher.name == subscriber.name and not self._barred(publisher):
                self.decision.offer(gateway, publisher, Purpose.PULL, subscriber.node)
                said.append(
                    _judged(
                        _reply(other, publisher.kind, publisher.name, publisher.node), None, gateway
                    )
                )
        return always(
            verdict.best(
                said, Verdict(State.NO_PUBLISHER, f"nobody here publishes {subscriber.name}")
            )
        )

    # Requests of other gateways

    def _take_request(
        self, gateway: str, other: Remote, interface: dict[tuple[Kind, str, str], Connection]
    ) -> None:
        for offer in other.request.offers:
            if offer.purpose == Purpose.FLIP:
                self._take_flipped(gateway, other, offer, Kind.PUBLISHER)
            elif offer.purpose == Purpose.SERVICE:
                self._take_flipped(gateway, other, offer, Kind.SERVICE)
            elif (
                offer.purpose == Purpose.PULL
                and (Kind.SUBSCRIBER, offer.topic, offer.to_node) in interface
            ):
                self._take_offer(
                    gateway,
                    other,
                    _offered_connection(offer, Kind.PUBLISHER),
                    re.escape(offer.to_node),
                )
        for want in other.request.wants:
            if want.purpose == Purpose.FLIP:
                self._take_flipped_subscriber(gateway, want)
                continue
            kind = _PULLED.get(want.purpose)
            if kind and (kind, want.topic, want.node) in interface:
                self.decision.export(gateway, interface[kind, want.topic, want.node])

    def _take_flipped(self, gateway: str, other: Remote, offer: Offer, kind: Kind) -> None:
        if self.situation.firewall:
            self.decision.reply(gateway, Reply(kind, offer.topic, offer.node, State.FIREWALLED))
            return
        connection = _offered_connection(offer, kind)
        self.flipped_in[Flipped(gateway, connection)] = None
        self._take_offer(gateway, other, connection, "")

    def _take_offer(self, gateway: str, other: Remote, offered: Connection, nodes: str) -> None:
        if offered.kind == Kind.SERVICE:
            judge = self.decision.import_service(gateway, other, offered)
        else:
            judge = self.decision.import_publisher(gateway, other, offered, nodes)

        def reply() -> Reply:
            said = judge()
            return Reply(offered.kind, offered.name, offered.node, said.state, said.reason)

        self.pending_replies.append((gateway, reply))

    def _take_flipped_subscriber(self, gateway: str, want: Want) -> None:
        if self.situation.firewall:
            self.decision.reply(
                gateway, Reply(Kind.SUBSCRIBER, want.topic, want.node, State.FIREWALLED)
            )
            return
        self.flipped_in[
            Flipped(gateway, Connection(Kind.SUBSCRIBER, want.topic, ANY, want.node))
        ] = None
        mine = [one for one in self.publishers if one.name == want.topic]
        allowed = [one for one in mine if not self._barred(one)]
        for connection in allowed:
            self.decision.offer(gateway, connection, Purpose.ANSWER)
        if allowed:
            said = Verdict(State.ACTIVE)
        elif mine:
            barrier = self._barred(mine[0])
            assert barrier is not None
            said = verdict.blacklisted(barrier, mine[0])
        else:
            said = verdict.no_publisher(want.topic, self.situation.local)
        self.decision.reply(
            gateway, Reply(Kind.SUBSCRIBER, want.topic, want.node, said.state, said.reason)
        )


_PULLED = {
    Purpose.PULL: Kind.PUBLISHER,
    Purpose.SERVICE: Kind.SERVICE,
    Purpose.PARAMETER: Kind.PARAMETER,
}
"""Kind of connection requested by a want, by its purpose."""


def _key(connection: Connection) -> tuple[Kind, str, str]:
    """Identifies a connection regardless of its type."""
    return connection.kind, connection.name, connection.node


def _barrier(blacklist: Iterable[Rule], connection: Connection) -> Rule | None:
    """Returns the first rule that matches a connection, or one of its topics if it is an action."""
    blacklist = tuple(blacklist)
    found = (
        blacklisting(blacklist, one) for one in dict.fromkeys((connection, *parts(connection)))
    )
    return next(filter(None, found), None)


def _of_action(
    action: Connection, at: str, judges: list[tuple[Kind, PendingVerdict]]
) -> PendingVerdict:
    return lambda: verdict.of_action(action, at, [(kind, judge()) for kind, judge in judges])


def _offered_connection(offer: Offer, kind: Kind) -> Connection:
    return Connection(kind, offer.topic, offer.type, offer.node)


def _reply(other: Remote, kind: Kind, topic: str, node: str) -> Reply | None:
    return next(
        (
            one
            for one in other.request.replies
            if (one.kind, one.topic, one.node) == (kind, topic, node)
        ),
        None,
    )


def _judged(answer: Reply | None, flipped_to: Remote | None, gateway: str) -> Verdict:
    """Returns the verdict of a reply; a firewall is known without a reply."""
    if flipped_to is not None and flipped_to.record.firewall:
        return Verdict(State.FIREWALLED, f"{gateway} accepts no flips")
    if answer is None:
        return verdict.NO_ANSWER
    return Verdict(answer.state, answer.reason)
