"""The address that a gateway announces to others."""

import pytest
import rosgraph.network

from rocon_gateway.hub import address

HUB = "192.168.2.100"
WAYS = {HUB: "192.168.2.101", "127.0.0.1": "127.0.0.1", "localhost": "127.0.0.1"}
"""By the hub's host, the address of the interface that leads there."""


def way(host: str) -> str:
    if host not in WAYS:
        raise OSError("Network is unreachable")
    return WAYS[host]


def own(monkeypatch: pytest.MonkeyPatch, towards: str, **environment: str) -> str:
    for name in ("ROS_HOSTNAME", "ROS_IP"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(address, "_route", way)
    monkeypatch.setattr(rosgraph.network, "get_local_address", lambda: "10.0.0.7")
    return address.own_address(towards)


@pytest.mark.parametrize(
    "environment",
    [
        {"ROS_IP": "127.0.0.1"},
        {"ROS_HOSTNAME": "localhost"},
        {"ROS_IP": "127.0.1.1"},
        {"ROS_IP": "::1"},
    ],
)
def test_a_hub_elsewhere_is_not_told_the_loopback_that_nodes_keep_to(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str]
) -> None:
    assert own(monkeypatch, HUB, **environment) == "192.168.2.101"


@pytest.mark.parametrize("towards", ["127.0.0.1", "localhost", "", "192.168.9.9"])
def test_a_configured_loopback_stays_with_a_local_absent_or_unreachable_hub(
    monkeypatch: pytest.MonkeyPatch, towards: str
) -> None:
    assert own(monkeypatch, towards, ROS_IP="127.0.0.1") == "127.0.0.1"


@pytest.mark.parametrize(
    "environment", [{"ROS_IP": "10.9.0.101"}, {"ROS_HOSTNAME": "aadi1", "ROS_IP": "127.0.0.1"}]
)
def test_any_other_address_that_is_set_is_reported(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str]
) -> None:
    assert own(monkeypatch, HUB, **environment) == next(iter(environment.values()))


def test_with_nothing_set_it_is_the_interface_that_leads_to_the_hub(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert own(monkeypatch, HUB) == "192.168.2.101"
    assert own(monkeypatch, "localhost") == own(monkeypatch, "") == "10.0.0.7"
