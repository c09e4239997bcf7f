"""Manages all our hubs: the configured ones and those found by mDNS."""

import logging
import random
import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from rocon_gateway.hub.client import RETRY, HubClient, HubContext
from rocon_gateway.hub.membership import Memberships, Overview
from rocon_gateway.hub.presence import Candidate, HubView, check_lists, names_address
from rocon_gateway.hub.session import Description, HubSession
from rocon_gateway.hub.state import Publication
from rocon_hub_protocol.address import HubAddress, address_from_uri
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.discovery import Discovery
from rocon_hub_protocol.record import PeerRequest, Record
from rocon_hub_protocol.redis_client import OPEN, Access
from rocon_hub_protocol.sighting import Sighting
from tcpros.loop_faults import LoopFaults

LOOK = 3.0
"""Duration of one mDNS search while we are on a hub [s]; without a hub, the search continues."""

REST = 30.0
"""Pause between two searches, which use some CPU time and traffic [s]."""

PATIENCE = 10.0
"""Time after which a lost announced hub is given up, if we are on another hub [s]."""

MOST_FOUND = 16
"""Maximum number of announced hubs joined or tried at once, one thread each; beyond it, unresponsive ones give way."""

MOST_COMPLAINTS, MOST_REASONS = 256, 16
"""Addresses, and reasons for each, that were logged and are not repeated; beyond these numbers they are forgotten."""

_SEARCH = "looking for a hub by mDNS; to name one: gateway_hub_uri:=http://HOST:6380 or the service ~connect_hub"
_NO_SEARCH = "no hub_uri is given and mDNS is off: waiting for a call of ~connect_hub"


@dataclass(frozen=True)
class HubsConfig:
    """Configuration of the hubs to join."""

    uris: tuple[str, ...] = ()  #: addresses of hubs
    whitelist: tuple[str, ...] = ()  #: hub names or addresses; empty allows all
    blacklist: tuple[str, ...] = ()  #: hub names or addresses; takes precedence over the whitelist
    discover: bool = False  #: also join hubs that announce themselves by mDNS
    distant: bool = False  #: those on other machines, too: only with a credential, or where everybody is trusted
    access: Access = OPEN  #: credentials for the hubs' Redis
    host: str = ""  #: our address for other gateways; empty: the one on the route to the hub
    namespaces: frozenset[str] = frozenset()  #: robot namespaces to announce to all
    #: called with the salt of each hub before joining, and when it changes, with the former one
    learn: Callable[[str, str], None] = lambda _salt, _former: None
    #: called with the text that a hub has stored for our name; returns the text to store from now on
    restore: Callable[[str], str] = lambda text: text


class Hubs:
    """All our hubs. Each has its own thread, so a hub that hangs does not block the others.

    Methods may be called from any thread. They do not block, except `connect`, `describe` and `shutdown`, which wait
    for hubs. `on_change()` is called from a hub's thread when `view()` has changed.

    Args:
        config: the hubs to join.
        record: our record until `publish` replaces it.
        linked: returns the gateways with open data links.
        on_change: see above.
        logger: receives one line when a hub is found and one when it is lost.
        examine: handles a request of the doctor that arrived over a session; must not block.
    """

    def __init__(
        self,
        config: HubsConfig,
        record: Record,
        linked: Callable[[], Collection[str]],
        on_change: Callable[[], None],
        logger: logging.Logger,
        examine: Callable[[HubSession, str], None],
    ) -> None:
        self._config = config
        self._on_change = on_change
        self._logger = logger
        self._said = Publication(record)
        self._context = HubContext(
            open=self._open,
            claim=self._claim,
            linked=linked,
            take=self._take,
            complain=self._complain,
            examine=examine,
            logger=logger,
            host=config.host,
            namespaces=config.namespaces,
            restore=config.restore,
            learn=config.learn,
        )
        self._changed = threading.Condition()
        self._memberships = Memberships()
        self._view = Overview()
        self._hubs: list[HubClient] = []
        self._claims: dict[str, HubClient] = {}
        self._refused: set[tuple[Candidate, ...]] = set()
        self._complaints: dict[object, set[str]] = {}
        self._distant_reported = False
        self._stopping = False
        self._woken = threading.Event()
        self._searcher: threading.Thread | None = None
        for uri in config.uris:
            self._add((Candidate(address_from_uri(uri)),), named=True)
        if config.discover:
            self._searcher = threading.Thread(target=self._search, name="hub search", daemon=True)
            self._searcher.start()
        if not config.uris:
            logger.info("%s", _SEARCH if config.discover else _NO_SEARCH)

    def view(self) -> Overview:
        """Returns the current overview, an immutable value."""
        with self._changed:
            return self._view

    def publish(
        self, record: Record, requests: Mapping[str, PeerRequest], interest: frozenset[str]
    ) -> None:
        """Sets our record, our request to each gateway, and the patterns of the gateways to follow."""
        said = Publication(record, requests, interest)
        with self._changed:
            if said == self._said:
                return
            self._said = said
            hubs = list(self._hubs)
        for hub in hubs:
            hub.publish(said)

    def keep(self, text: str) -> None:
        """Sets the text that every hub stores for the next gateway of our name."""
        with self._changed:
            hubs = list(self._hubs)
        for hub in hubs:
            hub.keep(text)

    def connect(self, uri: str, patience: float = 5.0) -> None:
        """Joins the hub at `uri` in addition to the current ones, and reconnects whenever it is lost.

        Raises:
            HubError: 11 if we are on that hub already, 14 if it failed, and those of `HubSession` and `check_lists`.
                A hub that could not be joined is not joined later either.
        """
        way = Candidate(address_from_uri(uri))
        session = self._open(way)
        session.close()
        with self._changed:
            if self._is_on(session.identity):
                raise HubError(
                    Code.HUB_CONNECTION_ALREADY_EXISTS, f"on hub '{session.hub_name}' already"
                )
            added = None
            if not any(way in hub.ways for hub in self._hubs):
                try:
                    added = self._add((way,), named=True)
                except OSError as error:
                    text = f"{way.address} cannot be joined: {error}"
                    raise HubError(Code.HUB_CONNECTION_FAILED, text) from None
            joined = self._changed.wait_for(lambda: self._is_on(session.identity), patience)
        if not joined:
            if added is not None:
                added.stop()
            raise HubError(
                Code.HUB_CONNECTION_FAILED, f"registering at {way.address} took too long"
            )

    def describe(self, names: Collection[str]) -> list[Description]:
        """Returns what the hubs know of these gateways, or of all if empty, each once; an empty list without a hub."""
        with self._changed:
            hubs = list(self._hubs)
        found: dict[str, Description] = {}
        for one in (one for hub in hubs for one in hub.describe(names)):
            known = found.get(one.record.name)
            if known is None or one.silence < known.silence:
                found[one.record.name] = one
        return [found[name] for name in sorted(found)]

    def shutdown(self) -> None:
        """Deregisters from every hub; does not wait for a hub that does not answer."""
        with self._changed:
            self._stopping = True
            hubs = list(self._hubs)
        self._woken.set()
        for hub in hubs:
            hub.stop()
        for hub in hubs:
            hub.join()
        if self._searcher:
            self._searcher.join(1.0)

    def _add(self, ways: tuple[Candidate, ...], named: bool) -> HubClient | None:
        """Adds a hub, unless we are stopping. Raises OSError if there is no descriptor or thread for it."""
        if self._stopping:
            return None
        hub = HubClient(ways, named, self._said, self._context)
        self._hubs.append(hub)
        return hub

    def _is_on(self, identity: str) -> bool:
        hub = self._claims.get(identity)
        return hub is not None and self._memberships.is_on(hub)

    # Callbacks from the hubs' threads

    def _open(self, way: Candidate) -> HubSession:
        record, config = self._said.record, self._config
        session = HubSession(way.address, config.access, record.name, record.instance)
        try:
            check_lists(
                way.address, session.hub_name, config.whitelist, config.blacklist, way.aliases
            )
        except HubError:
            session.close()
            raise
        return session

    def _claim(self, hub: HubClient, session: HubSession) -> None:
        with self._changed:
            if self._claims.get(session.identity, hub) is not hub:
                text = f"'{session.hub_name}' at {session.address} is a hub that we are on already"
                raise HubError(Code.HUB_CONNECTION_ALREADY_EXISTS, text)
            self._release(hub)
            self._claims[session.identity] = hub

    def _release(self, hub: HubClient) -> None:
        self._claims = {identity: one for identity, one in self._claims.items() if one is not hub}

    def _take(self, hub: HubClient, view: HubView | None) -> None:
        with self._changed:
            before = self._view.connected
            if view is None:
                self._view = self._memberships.drop(hub)
                self._hubs = [one for one in self._hubs if one is not hub]
                if hub.refused:
                    self._refused.add(hub.ways)
            else:
                self._view = self._memberships.take(hub, view)
                for way in hub.ways if view.connected else ():
                    self._complaints.pop(way.address, None)
            if view is None or not view.connected:
                self._release(hub)
            if view is not None and not view.connected:
                # Hubs refused because we were connected by another address may be tried again.
                self._refused.clear()
            if self._view.connected != before:
                self._woken.set()
            self._changed.notify_all()
        self._on_change()

    def _complain(self, about: object, complaint: str) -> None:
        """Logs why there is no hub: each reason once, also if several alternate, until a hub was found."""
        with self._changed:
            if about not in self._complaints and len(self._complaints) >= MOST_COMPLAINTS:
                self._complaints.clear()
            known = self._complaints.setdefault(about, set())
            is_new = complaint not in known
            if len(known) >= MOST_REASONS:
                known.clear()
            known.add(complaint)
        if is_new:
            self._logger.info("%s; retrying", complaint)

    # mDNS search

    def _search(self) -> None:
        discovery: Discovery | None = None
        rest_at = 0.0
        faults = LoopFaults(self._logger, "the search for hubs")
        while not self._stopping:
            with faults:
                now = time.monotonic()
                if discovery is None:
                    discovery = Discovery(self._woken.set)
                if not self.view().connected:
                    rest_at = now + LOOK
                if now < rest_at:
                    self._follow_as_possible(discovery)
                    self._woken.wait(RETRY)
                else:
                    discovery.rest()
                    if not self._woken.wait(REST):
                        rest_at = time.monotonic() + LOOK
            if faults.has_failed:
                self._woken.wait(RETRY)
            self._woken.clear()
        with faults:
            if discovery is not None:
                discovery.rest()

    def _follow_as_possible(self, discovery: Discovery) -> None:
        try:
            self._follow(discovery)
        except OSError as error:  # out of descriptors
            self._complain(HubClient, f"cannot join a hub that was found: {error}")

    def _follow(self, discovery: Discovery) -> None:
        """Joins new hubs; gives up lost ones if we are on another hub or other candidates are waiting."""
        seen = self._seen(discovery)
        crowded = len(seen) > MOST_FOUND
        with self._changed:
            self._refused.intersection_update(seen)
            # In random order: a client that announces thousands of hubs must not control which ones are tried.
            for ways in random.sample(seen, len(seen)):
                room = sum(not hub.named for hub in self._hubs) < MOST_FOUND
                if (
                    room
                    and ways not in self._refused
                    and not any(set(ways) & set(hub.ways) for hub in self._hubs)
                ):
                    self._add(ways, named=False)
            found = (
                [hub for hub in self._hubs if not hub.named]
                if self._view.connected or crowded
                else []
            )
            lost = [hub for hub in found if not self._memberships.is_on(hub)]
        for hub in lost:
            if (crowded and hub.failures > 1) or time.monotonic() - hub.lost_since > PATIENCE:
                hub.stop()

    def _seen(self, discovery: Discovery) -> list[tuple[Candidate, ...]]:
        try:
            sightings = discovery.sightings()
        except OSError as error:
            self._complain(Discovery, f"cannot look for hubs by mDNS: {error}")
            return []
        found = []
        for sighting in sightings:
            ways = self._ways(sighting, discovery)
            found.append(tuple(Candidate(way, sighting.hubs) for way in ways))
        return [ways for ways in found if ways]

    def _ways(self, sighting: Sighting, discovery: Discovery) -> tuple[HubAddress, ...]:
        """Returns the addresses under which an announced hub may be joined.

        Any host can announce a hub. One on another machine could ask for our topics and flip its own to us, and
        without a credential nothing would tell it from the fleet's. Then only addresses that the user has named in the
        whitelist count: the name of a hub, and the other addresses that it claims, are its own words. A false claim to
        be on this machine leads to the loopback.
        """
        ways = sighting.ways(discovery.interfaces, discovery.stack)
        if self._config.distant or sighting.is_local(discovery.interfaces, discovery.stack):
            return ways
        named = tuple(way for way in ways if names_address(self._config.whitelist, way))
        if not named:
            self._report_distant(sighting)
        return named

    def _report_distant(self, sighting: Sighting) -> None:
        if self._distant_reported:
            return
        self._distant_reported = True
        self._logger.warning(
            "hub '%s' at %s is on another machine and is not joined without a password or certificate: set one, "
            "name the hub with gateway_hub_uri, or on a network of your own use gateway_insecure:=true",
            sighting.name,
            ", ".join(map(str, sighting.hubs)),
        )
