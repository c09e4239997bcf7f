"""One run of a gateway in simulated time: hub client and compare loop, driven as by `HubClient` and `GatewayNode`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import redis
from gateway_model import FakeGateway
from redis_model import ClientModel, RedisModel, Subscription

from rocon_gateway.hub import session as hub_session
from rocon_gateway.hub.client import RETRY
from rocon_gateway.hub.membership import Memberships, Overview
from rocon_gateway.hub.presence import HubView
from rocon_gateway.hub.session import HEARTBEAT, HubSession, event_from_message
from rocon_gateway.hub.state import HubState, Publication
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.situation import Outcome, Situation
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.record import Record
from rocon_hub_protocol.redis_client import OPEN, TIMEOUT
from rocon_relay.connection import Export, Import, LinkState, LinkStatus

if TYPE_CHECKING:
    from world import World

HUB = HubAddress("hub", 6380)


@dataclass
class Computer(FakeGateway):
    """State that outlives a gateway's process: its rules and the nodes on its master."""

    process: Process | None = None

    @property
    def record(self) -> Record:
        assert self.process is not None
        return self.process.record(self.outcome)


@dataclass(eq=False)
class Process:
    """One run of a gateway on a computer."""

    world: World
    name: str
    computer: Computer
    session: HubSession | None = None
    view: HubView = field(default_factory=HubView)
    outcome: Outcome = field(default_factory=Outcome)
    links: dict[Import, LinkStatus] = field(default_factory=dict)
    exports: frozenset[Export] = frozenset()

    def __post_init__(self) -> None:
        self.port = next(self.world.numbers)
        self.instance = f"run {self.port}"
        self.state = HubState(Publication(self.record(Outcome())))
        self.client = ClientModel(self._server)
        self._memberships = Memberships()
        self._overview = Overview()
        self._turning = self._ended = False
        self.world.listening[self.port] = self
        self.wake()
        self._try()

    @property
    def events(self) -> Subscription | None:
        return self.session.events if self.session else None

    def record(self, outcome: Outcome) -> Record:
        book = self.computer.book
        rules = book.flips.rules, book.pulls.rules
        return Record(
            self.name, self.instance, self.name, self.port, False, outcome.advertised, *rules
        )

    def end(self, orderly: bool) -> None:
        if self._ended:
            return
        self._ended = True
        if self.session:
            with _lost_or_not():
                if orderly:
                    self.session.leave()
            self.session.close()
        self.session = None
        self.world.listening.pop(self.port, None)
        self.world.restart_links()

    def _server(self) -> RedisModel:
        if self.world.now < self.world.cut_from_hub.get(self.name, 0.0):
            raise redis.TimeoutError("Timeout reading from socket")
        return self.world.hub_server()

    # As in HubClient

    def _try(self) -> None:
        if self._ended:
            return
        with opened_by(self.client):
            try:
                session = HubSession(HUB, OPEN, self.name, self.instance)
                self.state.enter(session, self.name, self.world.now)
            except (HubError, redis.RedisError):
                self._retry(TIMEOUT if self.world.redis else 0.0)
                return
        self.session = session
        self._sync()
        if self.session is session:
            self._beat(session)
            self.take()

    def _retry(self, after: float = 0.0) -> None:
        self.world.at(
            self.world.now + after + RETRY * self.world.random.uniform(0.5, 1.5), self._try
        )

    @contextmanager
    def _visit(self) -> Iterator[None]:
        try:
            yield
        except (HubError, redis.RedisError):
            assert self.session is not None
            self.session.close()
            self.session = None
            self.state.leave()
            self._show()
            self._retry()

    def _sync(self) -> None:
        if self.session is None:
            return
        with self._visit():
            linked = self._linked() if self.state.waiting else ()
            self.state.update(self.session, linked, self.world.now)
            self._show()
            self.state.write(self.session)
        if self.session and self.state.waiting:
            self.world.at(self.world.now + 0.1, self._settle)

    def _settle(self) -> None:
        if self.state.waiting:
            self._sync()

    def _beat(self, session: HubSession) -> None:
        if self.session is not session:
            return
        with self._visit():
            self.state.heartbeat(session)
        self._sync()
        self.world.at(self.world.now + HEARTBEAT, lambda: self._beat(session))

    def take(self) -> None:
        if self.session is None or self._ended:
            return
        with self._visit():
            messages = self.session.events.take()
            events = [event for event in map(event_from_message, messages) if event]
            self.state.take(self.session, events, self.world.now)
        self._sync()

    def _show(self) -> None:
        if self.state.view != self.view:
            self.view = self.state.view
            self._overview = self._memberships.take(self, self.view)
            self.wake()

    def _linked(self) -> set[str]:
        up = {
            one.source_gateway for one, link in self.links.items() if link.state == LinkState.ACTIVE
        }
        feeding = {
            other.name
            for other in self.world.listening.values()
            for one, link in other.links.items()
            if link.state == LinkState.ACTIVE and one.source_gateway == self.name
        }
        return up | feeding

    # As in GatewayNode

    def wake(self) -> None:
        if not self._turning:
            self._turning = True
            self.world.soon(0.01, self._turn)

    def _turn(self) -> None:
        self._turning = False
        if self._ended:
            return
        book, view = self.computer.book, self._overview
        situation = Situation(
            book=book,
            firewall=False,
            local=frozenset(self.computer.local),
            connected=view.connected,
            names=view.names,
            remotes=view.remotes,
            links=self.links,
            robots=view.namespaces,
        )
        self.outcome = outcome = reconcile(situation)
        proxies = [(one.key.topic, one.proxy) for one in outcome.imports if one.source_node]
        assert len(proxies) == len(set(proxies)), f"{self.name} would register twice: {proxies}"
        if outcome.imports != self.links.keys() or outcome.exports != self.exports:
            pending = LinkStatus(LinkState.PENDING)
            self.links = {one: self.links.get(one, pending) for one in outcome.imports}
            self.exports = outcome.exports
            self.world.restart_links()
        interest = frozenset(remote.gateway for remote in (*book.flips.rules, *book.pulls.rules))
        said = Publication(self.record(outcome), outcome.requests, interest)
        if said != self.state.said:
            self.state.said = said
            self._sync()

    def check_links(self) -> None:
        if self._ended:
            return
        links = {one: LinkStatus(self._link_state(one)) for one in self.links}
        if links != self.links:
            self.links = links
            self.wake()

    def _link_state(self, wanted: Import) -> LinkState:
        other = self.world.listening.get(wanted.address.port)
        if other is None or self.world.is_cut(self.name, other.name):
            return LinkState.UNREACHABLE
        key = (wanted.subject, wanted.key.topic, self.name, wanted.key.source_node)
        exported = {
            (one.subject, one.key.topic, one.to_gateway, one.key.source_node)
            for one in other.exports
        }
        return LinkState.ACTIVE if key in exported else LinkState.REFUSED


@contextmanager
def opened_by(client: ClientModel) -> Iterator[None]:
    """Makes sessions connect to the simulated hub."""
    real = hub_session.redis_client, hub_session.unreachable
    hub_session.redis_client = lambda *_: client
    hub_session.unreachable = lambda *_: HubError(Code.HUB_CONNECTION_UNRESOLVABLE, "no hub there")
    try:
        yield
    finally:
        hub_session.redis_client, hub_session.unreachable = real


@contextmanager
def _lost_or_not() -> Iterator[None]:
    try:
        yield
    except redis.RedisError:
        return
