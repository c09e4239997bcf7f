"""Startup of the gateway's node, during which its master may disappear at any moment."""

import logging
from types import SimpleNamespace
from typing import Any

import pytest

from pioneer_harness.port import PortReservation
from rocon_gateway.node import gateway


def test_a_master_that_goes_before_the_look_for_a_hub_does_not_end_the_gateway(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ports = PortReservation()
    monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{ports.take(15411)}")
    node: Any = SimpleNamespace(name="/gateway", logger=logging.getLogger("gateway"))
    gateway._warn_on_the_hubs_master(node)
    ports.release()
