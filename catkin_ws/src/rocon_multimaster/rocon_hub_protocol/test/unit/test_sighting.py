"""Announced hubs: which of their addresses is used, and the name they announce."""

from ipaddress import IPv4Interface

import pytest

from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.sighting import LABEL_LENGTH, LOOPBACK, Sighting, instance_name

OWN = [
    IPv4Interface("127.0.0.1/8"),
    IPv4Interface("192.168.2.101/24"),
    IPv4Interface("172.17.0.1/16"),
]


def ways(*addresses: str, stack: str = "") -> list[str]:
    return [way.host for way in Sighting("Hub", 6380, addresses, stack).ways(OWN, "mine")]


def test_a_hub_of_this_machine_is_reached_by_the_loopback() -> None:
    assert ways("192.168.2.101", stack="mine") == [LOOPBACK]
    assert ways("192.168.2.101") == [LOOPBACK]
    assert ways(LOOPBACK) == [LOOPBACK]


def test_an_address_that_both_machines_have_does_not_make_a_hub_local() -> None:
    assert ways("172.17.0.1", "192.168.2.100", stack="theirs") == ["192.168.2.100"]


def test_addresses_in_a_network_of_ours_come_first() -> None:
    assert ways("10.0.0.7", "192.168.2.100", stack="theirs") == ["192.168.2.100", "10.0.0.7"]


def test_a_far_hub_that_is_on_its_loopback_only_cannot_be_reached() -> None:
    assert ways(LOOPBACK, stack="theirs") == []


@pytest.mark.parametrize("tls", [True, False])
def test_what_an_announcement_says_of_tls_goes_with_its_addresses(tls: bool) -> None:
    local, far = (Sighting("Hub", 1, ("10.0.0.7",), stack, tls) for stack in ("mine", "theirs"))
    assert {
        one.tls for sight in (local, far) for one in (*sight.hubs, *sight.ways(OWN, "mine"))
    } == {tls}


def test_lists_see_all_addresses() -> None:
    assert Sighting("Hub", 1, ("10.0.0.7",)).hubs == (HubAddress("10.0.0.7", 1),)


@pytest.mark.parametrize("hub", ["Pioneer Hub", "a.b", "ü" * 60])
def test_instance_names_differ_by_machine_and_port_and_fit_into_a_label(hub: str) -> None:
    names = {
        instance_name(hub, "base.lab", 6380),
        instance_name(hub, "base.lab", 6381),
        instance_name(hub, "x", 6380),
    }
    assert len(names) == 3
    assert all(len(name.encode()) <= LABEL_LENGTH and "." not in name for name in names)
    assert instance_name("Pioneer Hub", "base.lab", 6380) == "Pioneer Hub (base-lab:6380)"


def test_the_longest_host_names_give_different_instance_names_that_fit_into_a_label() -> None:
    for length in range(1, 256):
        names = {
            instance_name("Pioneer Hub", "h" * length + end, 65535)
            for end in ("", "a", "b", ".lan", "ü", "\udcff")
        }
        assert len(names) == 6
        assert all(
            len(name.encode()) <= LABEL_LENGTH and name.startswith("Pioneer Hub") for name in names
        )
