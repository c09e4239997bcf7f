"""Our place on a hub: a thread that finds the hub, keeps us registered, and tells when something changed there."""

import contextlib
import json
import logging
import os
import select
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field

import redis

from rocon_gateway.adapters.discovery import Discovery
from rocon_gateway.adapters.hub_session import HEARTBEAT, Description, HubSession
from rocon_gateway.core.code import Code, HubError
from rocon_gateway.core.hub import (
    GATEWAYS_KEY,
    Candidate,
    HubView,
    Presence,
    address_from_uri,
    check_lists,
    letters_key,
    record_key,
)
from rocon_gateway.core.record import EMPTY, Letter, Record
from rocon_gateway.core.rule import gateway_matches
from rocon_gateway.core.situation import Remote

RETRY = 0.5
"""Pause between two tries to reach a hub [s]."""

_SEARCH = "looking for a hub by mDNS; to name one: gateway_hub_uri:=http://HOST:6380 or the service ~connect_hub"
_NO_SEARCH = "no hub_uri is given and mDNS is off: waiting for a call of ~connect_hub"


@dataclass(frozen=True)
class HubConfig:
    """Which hubs we may join.

    Attributes:
        uris: addresses to try, in order.
        whitelist: hub names or addresses; empty allows all.
        blacklist: hub names or addresses; goes before the whitelist.
        discover: also look for hubs that announce themselves by mDNS.
        password: what the hubs' Redis asks for. Not shown by repr.
    """

    uris: tuple[str, ...] = ()
    whitelist: tuple[str, ...] = ()
    blacklist: tuple[str, ...] = ()
    discover: bool = False
    password: str | None = field(default=None, repr=False)


class Hub:
    """The gateway's connection to its hub, whichever hub that is at the moment; at most one at a time.

    Methods return at once and may be called from any thread, `connect`, `describe` and `shutdown` apart, which
    wait for the hub. `on_change()` is called from the hub's thread when `view()` has changed.

    Args:
        config: where hubs are.
        record: how we introduce ourselves until `publish` says more.
        linked: returns the gateways to which data links stand.
        on_change: see above.
        logger: takes one line when a hub is found and one when it is lost.
    """

    def __init__(
        self,
        config: HubConfig,
        record: Record,
        linked: Callable[[], Collection[str]],
        on_change: Callable[[], None],
        logger: logging.Logger,
    ) -> None:
        self._config = config
        self._linked = linked
        self._on_change = on_change
        self._logger = logger
        self._name, self._instance = record.name, record.instance
        self._lock = threading.Lock()
        self._known = [Candidate(address_from_uri(uri)) for uri in config.uris]
        self._discovery = Discovery(self._wake) if config.discover else None
        self._last: tuple[Candidate, ...] = ()
        self._record = record
        self._letters: Mapping[str, Letter] = {}
        self._interest: frozenset[str] = frozenset()
        self._view = HubView()
        self._presence = Presence()
        self._session: HubSession | None = None
        self._connected = threading.Condition(self._lock)
        self._displaced = False
        self._complaints: dict[object, str] = {}
        self._stopping = False
        self._wake_reader, self._wake_writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._thread = threading.Thread(target=self._run, name="hub", daemon=True)
        self._thread.start()

    def view(self) -> HubView:
        """Returns what is known now; a value that does not change."""
        with self._lock:
            return self._view

    def publish(self, record: Record, letters: Mapping[str, Letter], interest: frozenset[str]) -> None:
        """Sets what we tell all, what we tell each, and which gateways (patterns) we want to hear of."""
        with self._lock:
            if (record, letters, interest) == (self._record, self._letters, self._interest):
                return
            self._record, self._letters, self._interest = record, letters, interest
        self._wake()

    def connect(self, uri: str, patience: float = 5.0) -> None:
        """Joins the hub at `uri`, and tries that address again whenever the hub is lost.

        Raises:
            HubError: 11 if we are there, 14 if we are on another hub or it did not work out, and what
                `HubSession` and `check_lists` raise.
        """
        address = address_from_uri(uri)
        view = self.view()
        if view.connected:
            same = view.hub_uri == str(address)
            code = Code.HUB_CONNECTION_ALREADY_EXISTS if same else Code.HUB_CONNECTION_FAILED
            raise HubError(code, f"connected to '{view.hub_name}' at {view.hub_uri} already; one hub at a time")
        self._probe(Candidate(address))
        with self._connected:
            if Candidate(address) not in self._known:
                self._known.insert(0, Candidate(address))
            self._wake()
            if not self._connected.wait_for(lambda: self._view.connected, patience):
                raise HubError(Code.HUB_CONNECTION_FAILED, f"registering at {address} took too long")

    def _probe(self, candidate: Candidate) -> None:
        session = HubSession(candidate.address, self._config.password, self._name, self._instance)
        try:
            self._check(candidate, session)
        finally:
            session.close()

    def _check(self, candidate: Candidate, session: HubSession) -> None:
        lists = self._config.whitelist, self._config.blacklist
        check_lists(candidate.address, session.hub_name, *lists, candidate.aliases)

    def describe(self, names: Collection[str]) -> list[Description]:
        """Returns what the hub knows of these gateways, of all if empty. Without a hub, nothing."""
        session = self._session
        if session is None:
            return []
        try:
            return session.describe(names)
        except (redis.RedisError, OSError):
            return []

    def shutdown(self) -> None:
        """Takes our leave and ends the thread; a hub that does not answer is not waited for."""
        self._stopping = True
        self._wake()
        # The thread may be in a call that takes `TIMEOUT`; it ends with the process, and the hub sees us expire.
        self._thread.join(1.5 if self._session else 0.3)

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._wake_writer, b"x")

    # The thread

    def _run(self) -> None:
        if not self._known:
            self._logger.info("%s", _SEARCH if self._discovery else _NO_SEARCH)
        while not self._stopping:
            for candidate in self._candidates():
                if self._visit(candidate) or self._stopping:
                    break
            self._pause(RETRY)
        if self._discovery:
            self._discovery.rest()

    def _candidates(self) -> list[Candidate]:
        """Returns whom to try now: the hub that we lost, then those we were told of, then those we see."""
        with self._lock:
            known = [*self._last, *self._known]
        return list(dict.fromkeys([*known, *self._seen()]))

    def _seen(self) -> list[Candidate]:
        if self._discovery is None:
            return []
        try:
            sightings = self._discovery.sightings()
        except OSError as error:
            self._complain(Discovery, f"cannot look for hubs by mDNS: {error}")
            return []
        own, stack = self._discovery.interfaces, self._discovery.stack
        return [Candidate(way, sighting.hubs) for sighting in sightings for way in sighting.ways(own, stack)]

    def _pause(self, seconds: float) -> None:
        if not self._stopping:
            select.select([self._wake_reader], [], [], seconds)
        self._drain()

    def _drain(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.read(self._wake_reader, 4096)

    def _visit(self, candidate: Candidate) -> bool:
        """Stays on this hub as long as that goes; tells whether it went at all."""
        session = None
        try:
            session = HubSession(candidate.address, self._config.password, self._name, self._instance)
            self._check(candidate, session)
            self._enter(session)
        except (HubError, redis.RedisError, OSError) as error:
            self._complain(candidate.address, str(error))
            if session:
                session.close()
            return False
        self._last = (candidate,)
        try:
            self._stay(session)
        except (HubError, redis.RedisError, OSError) as error:
            if not self._stopping:
                self._logger.warning("hub '%s' lost (%s); running links go on, reconnecting", session.hub_name, error)
        finally:
            self._exit(session)
        return True

    def _complain(self, about: object, complaint: str) -> None:
        """Says why there is no hub: once, until the reason changes or a hub was found."""
        if complaint != self._complaints.get(about):
            self._logger.info("%s; trying on", complaint)
        self._complaints[about] = complaint

    def _enter(self, session: HubSession) -> None:
        if self._displaced and session.holder not in (None, self._instance):
            raise HubError(Code.HUB_CONNECTION_FAILED, f"another gateway bears our name '{self._name}'")
        self._displaced = False
        session.join(self._record)
        self._presence.start(session.present(), time.monotonic())
        self._session = session
        self._watched: set[str] = set()
        self._records: dict[str, Record] = {
            name: remote.record for name, remote in self._view.remotes.items() if name in self._presence.names
        }
        self._inbox: dict[str, Letter] = {
            name: remote.letter for name, remote in self._view.remotes.items() if name in self._presence.names
        }
        self._take_letters(session, None)
        self._complaints.clear()
        if self._discovery:
            self._discovery.rest()
        self._logger.info("on hub '%s' at %s as '%s'", session.hub_name, session.address, self._name)

    def _exit(self, session: HubSession) -> None:
        self._session = None
        with contextlib.suppress(redis.RedisError, OSError):
            if self._stopping:
                session.leave()
        session.close()
        with self._lock:
            old = self._view
            self._view = HubView(False, old.hub_name, old.hub_uri, old.names, old.remotes)
        self._on_change()

    def _stay(self, session: HubSession) -> None:
        beat = time.monotonic()
        while not self._stopping:
            self._look(session)
            with self._lock:
                record, letters = self._record, self._letters
            session.write(record, letters)
            now = time.monotonic()
            if now >= beat:
                self._live(session)
                beat = now + HEARTBEAT
            wait = 0.1 if self._presence.waiting else max(0.0, beat - now)
            # Something may have been read from the socket already, together with the answer to a subscription.
            ready = select.select([session.events.connection._sock, self._wake_reader], [], [], wait)[0]
            if self._wake_reader in ready:
                self._drain()
            for channel, text in self._events(session):
                self._take_event(session, channel, text)

    def _events(self, session: HubSession) -> Iterator[tuple[str, str]]:
        while True:
            message = session.events.get_message()
            if message is None and not session.events.connection.can_read():
                return
            if message is None:
                continue
            if message["type"] == "message":
                yield message["channel"], message["data"]
            elif message["type"] == "subscribe":
                yield message["channel"], message["channel"].removeprefix(record_key(""))

    def _live(self, session: HubSession) -> None:
        holder = session.live()
        if holder is None:
            # The hub has forgotten us: it was emptied, or we were silent for too long.
            session.join(self._record)
        elif holder != self._instance:
            self._displaced = True
            raise HubError(Code.HUB_CONNECTION_LOST, f"another gateway took our name '{self._name}'")

    def _take_event(self, session: HubSession, channel: str, text: str) -> None:
        if channel == GATEWAYS_KEY:
            self._take_gateway_event(session, text)
        elif channel == letters_key(self._name):
            self._take_letters(session, {text})
        elif channel == record_key(text):
            self._records.update(session.records([text]))

    def _take_gateway_event(self, session: HubSession, text: str) -> None:
        try:
            event = json.loads(text)
            name, what = event["gateway"], event["event"]
        except (ValueError, TypeError, KeyError):
            return
        if name == self._name:
            return
        if what == "joined":
            self._presence.join(name)
            session.forget(name)
            if name in self._watched:
                self._records.update(session.records([name]))
            self._take_letters(session, {name})
        elif what == "left":
            self._presence.leave(name)
        elif what == "expired":
            self._presence.expire(name, time.monotonic())

    def _take_letters(self, session: HubSession, senders: Collection[str] | None) -> None:
        for sender, letter in session.letters(senders).items():
            if letter is None:
                self._inbox.pop(sender, None)
            else:
                self._inbox[sender] = letter

    def _look(self, session: HubSession) -> None:
        """Follows whom our rules and their letters concern, and makes the view of it."""
        if self._presence.waiting:
            self._presence.settle(self._linked(), time.monotonic())
        names = self._presence.names
        with self._lock:
            interest = self._interest
        concerned = {
            name for name in names if name in self._inbox or any(gateway_matches(one, name) for one in interest)
        }
        self._follow(session, concerned)
        for gone in {*self._inbox, *self._records} - names:
            self._inbox.pop(gone, None)
            self._records.pop(gone, None)
        remotes = {
            name: Remote(self._records[name], self._inbox.get(name, EMPTY))
            for name in sorted(concerned)
            if name in self._records
        }
        self._show(HubView(True, session.hub_name, str(session.address), names, remotes))

    def _follow(self, session: HubSession, concerned: set[str]) -> None:
        new = concerned - self._watched
        if new:
            session.watch(new)
        if self._watched - concerned:
            session.unwatch(self._watched - concerned)
        self._watched = concerned

    def _show(self, view: HubView) -> None:
        with self._connected:
            if view == self._view:
                return
            self._view = view
            self._connected.notify_all()
        self._on_change()
