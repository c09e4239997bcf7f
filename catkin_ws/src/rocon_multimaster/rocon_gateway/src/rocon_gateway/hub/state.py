"""Our state on one hub: a state machine without threads, clocks or sockets.

`HubClient` drives it from a thread with a real session; the fault simulation drives it with simulated time.
"""

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from rocon_gateway.hub.presence import HubView, Presence
from rocon_gateway.rules.matching import gateways_meant
from rocon_gateway.rules.situation import Remote
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import GATEWAYS_KEY, record_key, requests_key
from rocon_hub_protocol.record import (
    NO_REQUEST,
    PeerRequest,
    Record,
    RecordError,
    is_gateway_name,
    sound_namespaces,
)


@dataclass(frozen=True)
class Publication:
    """What we publish on the hub."""

    record: (
        Record  #: our record; `HubState` fills in the host, which depends on the route to the hub
    )
    requests: Mapping[str, PeerRequest] = field(
        default_factory=dict
    )  #: our request to each other gateway
    interest: frozenset[str] = frozenset()  #: patterns of the gateways whose records we follow


class Session(Protocol):
    """The connection to a hub as the state machine needs it; `hub.session.HubSession` documents the methods.

    Each method may raise the connection's own errors. This ends the visit, and `HubState.leave` must be called.
    """

    name: str
    instance: str
    hub_name: str
    address: HubAddress

    @property
    def holder(self) -> str | None: ...  # noqa: D102 - documented by HubSession, as are the others
    def join(  # noqa: D102
        self, record: Record, requests: Mapping[str, PeerRequest], namespaces: Collection[str] = ...
    ) -> None: ...
    def namespaces(self) -> frozenset[str]: ...  # noqa: D102
    def live(self) -> tuple[str | None, bool]: ...  # noqa: D102
    def present(self) -> set[str]: ...  # noqa: D102
    def watch(self, names: Iterable[str]) -> None: ...  # noqa: D102
    def unwatch(self, names: Iterable[str]) -> None: ...  # noqa: D102
    def records(self, names: Collection[str]) -> dict[str, Record | RecordError]: ...  # noqa: D102
    def requests(self, senders: Collection[str] | None = ...) -> dict[str, PeerRequest | None]: ...  # noqa: D102
    def write(self, record: Record, requests: Mapping[str, PeerRequest]) -> None: ...  # noqa: D102
    def forget(self, receiver: str) -> None: ...  # noqa: D102


@dataclass
class _News:
    """Names of gateways whose records, or requests to us, have changed according to events."""

    senders: set[str] = field(default_factory=set)
    records: set[str] = field(default_factory=set)


class HubState:
    """Keeps us registered on a hub and tracks the other gateways on it. Times are monotonic [s].

    A visit starts with `enter` and ends with `leave`. In between, call `update` and `write` after `take` and
    `heartbeat`, and whenever `said` or `waiting` has changed. The knowledge about the hub survives between visits.

    Args:
        said: what we publish; may be replaced at any time.
        namespaces: robot namespaces to publish to all.
    """

    def __init__(self, said: Publication, namespaces: Collection[str] = ()) -> None:
        self.said = said
        self.view = HubView()  #: what we know about the hub and the gateways on it
        self.displaced = False  #: whether another gateway has taken our name; `enter` then fails while it is alive
        self.faults: dict[str, str] = {}  #: by gateway, what is wrong with its record on the hub
        self._own_namespaces = namespaces
        self._namespaces: frozenset[str] = frozenset()
        self._host = ""
        self._told = said.record, said.record
        self._presence = Presence()
        self._watched: set[str] = set()
        self._records: dict[str, Record] = {}
        self._inbox: dict[str, PeerRequest] = {}

    @property
    def waiting(self) -> bool:
        """Whether a gateway that is no longer listed is retained for a while, so that `update` must be called soon."""
        return self._presence.waiting

    def enter(self, session: Session, host: str, now: float) -> None:
        """Registers us on the hub to which `session` has just connected; `host` is our address for other gateways."""
        if self.displaced and session.holder not in (None, session.instance):
            raise HubError(
                Code.HUB_CONNECTION_FAILED, f"another gateway is registered as '{session.name}'"
            )
        self.displaced = False
        self._host = host
        self._presence.start(session.present(), now)
        session.join(self._record, self._requests, self._own_namespaces)
        self._namespaces |= session.namespaces()
        self._watched = set()
        # A listed gateway's request is on the hub or was withdrawn; the other gateways have not rewritten theirs yet.
        known = {
            name: remote
            for name, remote in self.view.remotes.items()
            if name in self._presence.names
        }
        self._records = {name: remote.record for name, remote in known.items()}
        self._inbox = {name: known[name].request for name in known.keys() - self._presence.listed}
        self._take_requests(session, None)

    def leave(self) -> None:
        """Ends the visit; the view keeps the last known state."""
        self.view = replace(self.view, connected=False)

    def heartbeat(self, session: Session) -> bool:
        """Renews our registration; raises HubError if another gateway has taken our name.

        Returns whether the hub had lost us, and so perhaps everything else of us, and we have joined it again.
        """
        holder, listed = session.live()
        if holder is None or (holder == session.instance and not listed):
            # The hub has lost our registration: it was cleared, or we were silent for too long.
            session.join(self._record, self._requests, self._own_namespaces)
            return True
        if holder != session.instance:
            self.displaced = True
            raise HubError(
                Code.HUB_CONNECTION_LOST, f"another gateway took our name '{session.name}'"
            )
        return False

    def take(self, session: Session, events: Iterable[tuple[str, str]], now: float) -> None:
        """Handles events, given as (channel, text), and reads all changed data in one go."""
        news = _News()
        for channel, text in events:
            if channel == GATEWAYS_KEY:
                self._take_gateway_event(session, text, news, now)
            elif channel == requests_key(session.name):
                news.senders.add(text)
            elif channel == record_key(text):
                news.records.add(text)
        if news.records:
            self._take_records(session, news.records)
        if news.senders:
            self._take_requests(session, news.senders)

    def update(self, session: Session, linked: Collection[str], now: float) -> None:
        """Subscribes to the gateways that concern us, and updates the view.

        Args:
            session: the session of this visit.
            linked: gateways with open data links.
            now: the time.
        """
        if self._presence.waiting:
            self._presence.settle(linked, now)
        names, interest = self._presence.names, self.said.interest
        concerned = (self._inbox.keys() & names).union(
            *(gateways_meant(one, names) for one in interest)
        )
        self._follow(session, concerned)
        for gone in {*self._inbox, *self._records, *self.faults} - names:
            self._inbox.pop(gone, None)
            self._records.pop(gone, None)
            self.faults.pop(gone, None)
        remotes = {
            name: Remote(self._records[name], self._inbox.get(name, NO_REQUEST))
            for name in sorted(concerned)
            if name in self._records
        }
        listed = frozenset(self._presence.listed)
        hub = session.hub_name, str(session.address), self._host
        self.view = HubView(True, *hub, listed, names, remotes, self._namespaces)

    def write(self, session: Session) -> None:
        """Writes changes of what we publish, or of its receivers."""
        session.write(self._record, self._requests)

    @property
    def _record(self) -> Record:
        """Our record with the host; the same object as long as nothing changes, because it is compared often."""
        if self._told[0] is not self.said.record or self._told[1].host != self._host:
            self._told = self.said.record, replace(self.said.record, host=self._host)
        return self._told[1]

    @property
    def _requests(self) -> dict[str, PeerRequest]:
        """Our requests to the gateways on this hub."""
        here = self._presence.names
        return {name: request for name, request in self.said.requests.items() if name in here}

    def _take_gateway_event(self, session: Session, text: str, news: _News, now: float) -> None:
        try:
            event = json.loads(text)
            name, what = event["gateway"], event["event"]
        except (ValueError, TypeError, KeyError, RecursionError):
            return
        if name == session.name or not is_gateway_name(name):
            return
        if what == "joined":
            self._presence.join(name)
            self._namespaces |= sound_namespaces(event.get("namespaces"))
            session.forget(name)
            news.senders.add(name)
            if name in self._watched:
                news.records.add(name)
        elif what == "left":
            self._presence.leave(name)
        elif what == "expired":
            self._presence.expire(name, now)

    def _take_records(self, session: Session, names: Collection[str]) -> None:
        """Reads these records. An invalid one replaces the former one; one that is missing does not."""
        for name, record in session.records(names).items():
            if isinstance(record, Record):
                self._records[name] = record
                self.faults.pop(name, None)
            else:
                self._records.pop(name, None)
                self.faults[name] = str(record)

    def _take_requests(self, session: Session, senders: Collection[str] | None) -> None:
        for sender, request in session.requests(senders).items():
            if request is None:
                self._inbox.pop(sender, None)
            else:
                self._inbox[sender] = request

    def _follow(self, session: Session, concerned: set[str]) -> None:
        new = concerned - self._watched
        if new:
            session.watch(new)
        if self._watched - concerned:
            session.unwatch(self._watched - concerned)
        self._watched = concerned
