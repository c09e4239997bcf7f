"""A hub's Redis and clients of it without gateways: the test decides what they report."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import redis

from pioneer_harness.port import PortReservation
from pioneer_harness.wait import wait_until
from rocon_gateway.hub.client import HubClient, HubContext
from rocon_gateway.hub.presence import Candidate, HubView
from rocon_gateway.hub.session import HubSession
from rocon_gateway.hub.state import Publication
from rocon_hub.config import HubConfig
from rocon_hub.redis_server import RedisServer
from rocon_hub.registry import Registry
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.record import Offer, PeerRequest, Purpose, Record
from rocon_hub_protocol.redis_client import OPEN

REQUEST = PeerRequest(offers=(Offer("/flow", "std_msgs/String", "/talker", Purpose.FLIP),))


class Seat:
    """One gateway's connection to a hub, which the test can cut and restore."""

    def __init__(
        self, name: str, port: int, instance: str, restore: Callable[[str], str] = str
    ) -> None:
        #: view: its current view of the hub
        self.name, self.view, self.is_barred = name, HubView(), False
        self.session: Any = None  #: its connection
        #: called before each attempt to join the hub, in the thread that tries
        self.before_try: Callable[[], object] = list
        self.tries = 0  #: number of attempts to join the hub
        self.complaints: list[
            tuple[int, str]
        ] = []  #: reasons why it is not on the hub, each with the attempt's number
        self._address, self._instance = HubAddress("127.0.0.1", port), instance
        context = HubContext(
            open=self._open,
            claim=lambda _hub, _session: None,
            linked=lambda: (),
            take=self._take,
            complain=lambda _about, why: self.complaints.append((self.tries, why)),
            examine=lambda _session, _request: None,
            logger=logging.getLogger("seat"),
            restore=restore,
        )
        self._hub = HubClient([Candidate(self._address)], True, self._said({}), context)

    def _open(self, _way: Candidate) -> HubSession:
        if self.is_barred:
            raise HubError(Code.HUB_CONNECTION_UNRESOLVABLE, "barred")
        self.tries += 1
        self.before_try()
        self.session = HubSession(self._address, OPEN, self.name, self._instance)
        return self.session

    def _take(self, _hub: HubClient, view: HubView | None) -> None:
        self.view = view or HubView()

    def _said(self, requests: dict[str, PeerRequest]) -> Publication:
        return Publication(
            Record(self.name, self._instance, "127.0.0.1", 9), requests, frozenset({".*"})
        )

    def tell(self, **requests: PeerRequest) -> None:
        """Sets its requests to other gateways."""
        self._hub.publish(self._said(requests))

    def keep(self, text: str) -> None:
        """Stores a text on the hub for the next gateway of the same name."""
        self._hub.keep(text)

    def hears(self, sender: str) -> PeerRequest | None:
        """Returns the request of `sender` as this gateway sees it; None if it does not know the sender."""
        remote = self.view.remotes.get(sender)
        return remote.request if remote else None

    def connected(self) -> "Seat":
        wait_until(lambda: self.view.connected, f"{self.name} on the hub", 5)
        return self

    def lose(self) -> None:
        """Cuts its connection and prevents it from reconnecting."""
        self.is_barred = True
        self.session.events.connection._sock.shutdown(2)
        wait_until(lambda: not self.view.connected, f"{self.name} off the hub", 5)

    def find(self) -> None:
        """Lets it reconnect and waits until it has."""
        self.is_barred = False
        self.connected()

    def leave(self) -> None:
        """Deregisters from the hub."""
        self._hub.stop()
        self._hub.join()


class Bench:
    """A Redis with a hub's keys, and the seats on it."""

    def __init__(self, folder: Path) -> None:
        self._ports = PortReservation()
        self.port = self._ports.take(19380)
        self.server = RedisServer(HubConfig(port=self.port), folder / "redis", OPEN)
        self.server.start()
        self.client: redis.Redis = self.server.client
        self.registry = Registry(self.client, 60.0)
        self.registry.open("Test Hub")
        self.seats: list[Seat] = []

    def seat(
        self, name: str, instance: str = "1", port: int = 0, restore: Callable[[str], str] = str
    ) -> Seat:
        self.seats.append(Seat(name, port or self.port, instance, restore))
        return self.seats[-1].connected()

    def close(self) -> None:
        for seat in self.seats:
            seat.leave()
        self.server.stop()
        self._ports.release()
