"""Discovery of announced hubs survives errors."""

import logging
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from rocon_gateway.adapters import hubs
from rocon_gateway.adapters.hubs import Hubs, HubsConfig
from rocon_hub_protocol.core.address import HubAddress
from rocon_hub_protocol.core.record import Record

SIGHTING = SimpleNamespace(hubs=(), ways=lambda _own, _stack: [HubAddress("127.0.0.1", 9)])


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
        return SimpleNamespace(ways=ways, named=False, lost_since=0.0, stop=lambda: None, join=lambda: None)

    def discovery(_on_change: Any) -> SimpleNamespace:
        return SimpleNamespace(sightings=lambda: [SIGHTING], rest=lambda: None, interfaces=frozenset(), stack=None)

    monkeypatch.setattr(hubs, "HubClient", hub)
    monkeypatch.setattr(hubs, "Discovery", discovery)
    monkeypatch.setattr(hubs, "RETRY", 0.01)
    caplog.set_level(logging.INFO)
    record = Record("a", "1", "127.0.0.1", 9)
    made = Hubs(HubsConfig(discover=True), record, lambda: (), lambda: None, logging.getLogger("test"))
    try:
        assert joined.wait(10)
    finally:
        made.shutdown()
    assert caplog.text.count("cannot join a hub that was found: [Errno 24] Too many open files; retrying") == 1
