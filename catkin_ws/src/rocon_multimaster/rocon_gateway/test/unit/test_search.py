"""Discovery of announced hubs survives errors."""

import logging
import threading
from ipaddress import IPv4Interface
from types import SimpleNamespace
from typing import Any

import pytest

from rocon_gateway.doctor.examiner import Examiner
from rocon_gateway.hub import hubs
from rocon_gateway.hub.hubs import Hubs, HubsConfig
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.record import Record
from rocon_hub_protocol.sighting import Sighting

SIGHTING = SimpleNamespace(
    hubs=(),
    ways=lambda _own, _stack: [HubAddress("127.0.0.1", 9)],
    is_local=lambda _own, _stack: True,
)
HERE, THERE = "stack-here", "stack-there"
OWN = frozenset([IPv4Interface("192.168.2.7/24")])


def test_a_gateway_that_has_no_descriptor_for_a_hub_joins_it_once_there_is_one(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The first error once ended the search, so every hub that appeared later was never found."""
    tries, joined = [], threading.Event()

    def hub(ways: Any, *_: Any) -> SimpleNamespace:
        tries.append(ways)
        if len(tries) < 3:
            raise OSError(24, "Too many open files")
        joined.set()
        return SimpleNamespace(
            ways=ways, named=False, lost_since=0.0, stop=lambda: None, join=lambda: None
        )

    def discovery(_on_change: Any) -> SimpleNamespace:
        return SimpleNamespace(
            sightings=lambda: [SIGHTING], rest=lambda: None, interfaces=frozenset(), stack=None
        )

    monkeypatch.setattr(hubs, "HubClient", hub)
    monkeypatch.setattr(hubs, "Discovery", discovery)
    monkeypatch.setattr(hubs, "RETRY", 0.01)
    caplog.set_level(logging.INFO)
    record = Record("a", "1", "127.0.0.1", 9)
    made = Hubs(
        HubsConfig(discover=True),
        record,
        lambda: (),
        lambda: None,
        logging.getLogger("test"),
        Examiner().asked,
    )
    try:
        assert joined.wait(10)
    finally:
        made.shutdown()
    assert (
        caplog.text.count(
            "cannot join a hub that was found: [Errno 24] Too many open files; retrying"
        )
        == 1
    )


def test_reasons_that_alternate_are_logged_once_each(caplog: pytest.LogCaptureFixture) -> None:
    """A hub that slows guesses down answered BUSY and "wrong password" in turn: two lines for each attempt."""
    caplog.set_level(logging.INFO)
    made = Hubs(
        HubsConfig(),
        Record("a", "1", "127.0.0.1", 9),
        lambda: (),
        lambda: None,
        logging.getLogger("test"),
        Examiner().asked,
    )
    for _ in range(20):
        for reason in ("the hub is BUSY", "wrong password"):
            made._context.complain("192.168.2.100:6380", reason)
    made.shutdown()
    assert caplog.text.count("the hub is BUSY; retrying") == 1
    assert caplog.text.count("wrong password; retrying") == 1


@pytest.mark.parametrize(
    ("sighting", "config", "joined"),
    [
        (Sighting("far", 6380, ("192.168.2.66",), THERE), {}, []),
        (Sighting("far", 6380, ("192.168.2.66",), THERE), {"distant": True}, ["192.168.2.66"]),
        (Sighting("near", 6380, ("192.168.2.7",), HERE), {}, ["127.0.0.1"]),
        # What claims to be on this machine leads to the loopback, where no other machine answers.
        (Sighting("claim", 6380, ("192.168.2.66",), HERE), {}, ["127.0.0.1"]),
        (Sighting("claim", 6380, ("192.168.2.7",), ""), {}, ["127.0.0.1"]),
        # Any host can announce a name, and any address beside its own.
        (Sighting("far", 6380, ("192.168.2.66",), THERE), {"whitelist": ("far",)}, []),
        (
            Sighting("far", 6380, ("192.168.2.66", "192.168.2.8"), THERE),
            {"whitelist": ("http://192.168.2.8:6380",)},
            ["192.168.2.8"],
        ),
        (
            Sighting("far", 6381, ("192.168.2.66", "192.168.2.8"), THERE),
            {"whitelist": ("192.168.2.8",)},
            [],
        ),
    ],
)
def test_without_a_credential_a_hub_that_another_machine_announces_is_not_joined(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    sighting: Sighting,
    config: dict[str, Any],
    joined: list[str],
) -> None:
    """Such a hub could once flip its topics into a gateway without a password, and drive its robot."""
    tried: list[str] = []
    looked = threading.Semaphore(0)

    def hub(ways: Any, *_: Any) -> SimpleNamespace:
        tried.extend(way.address.host for way in ways)
        return SimpleNamespace(
            ways=ways, named=False, lost_since=0.0, stop=lambda: None, join=lambda: None
        )

    def sightings() -> list[Sighting]:
        looked.release()
        return [sighting]

    def discovery(_on_change: Any) -> SimpleNamespace:
        return SimpleNamespace(sightings=sightings, rest=lambda: None, interfaces=OWN, stack=HERE)

    monkeypatch.setattr(hubs, "HubClient", hub)
    monkeypatch.setattr(hubs, "Discovery", discovery)
    monkeypatch.setattr(hubs, "RETRY", 0.01)
    record = Record("a", "1", "127.0.0.1", 9)
    made = Hubs(
        HubsConfig(discover=True, **config),
        record,
        lambda: (),
        lambda: None,
        logging.getLogger("test"),
        Examiner().asked,
    )
    try:
        for _ in range(3):  # the third look begins once the first has been worked on
            assert looked.acquire(timeout=10)
    finally:
        made.shutdown()
    assert tried == joined
    assert caplog.text.count("is on another machine and is not joined") == (0 if joined else 1)
