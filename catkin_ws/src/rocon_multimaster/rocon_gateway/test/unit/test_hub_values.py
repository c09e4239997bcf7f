"""Addresses of hubs, lists of hubs, and which gateways count as present."""

import pytest

from rocon_gateway.hub.presence import Presence, check_lists
from rocon_hub_protocol.address import HubAddress, address_from_uri
from rocon_hub_protocol.code import Code, HubError

HUB = HubAddress("192.168.2.100", 6380)


@pytest.mark.parametrize(
    "uri",
    [
        "http://192.168.2.100:6380",
        "http://192.168.2.100:6380/",
        "192.168.2.100:6380",
        "192.168.2.100",
    ],
)
def test_an_address_may_be_written_in_several_ways(uri: str) -> None:
    assert address_from_uri(uri) == HUB


def test_a_hub_with_tls_is_the_same_hub_and_reports_it() -> None:
    address = address_from_uri("rediss://192.168.2.100:6380")
    assert (address, address.tls, str(address)) == (HUB, True, "rediss://192.168.2.100:6380")
    assert not address_from_uri("http://192.168.2.100:6380").tls
    check_lists(address, "Pioneer Hub", ["192.168.2.100"], [])


def test_an_ipv6_address_is_written_in_brackets() -> None:
    assert address_from_uri("http://[::1]:6390") == HubAddress("::1", 6390)


@pytest.mark.parametrize(
    "uri", ["", "http://", "a b", "host:port", "host:0", "host:99999", "http://host:1:2"]
)
def test_what_is_no_address_is_unresolvable(uri: str) -> None:
    with pytest.raises(HubError) as caught:
        address_from_uri(uri)
    assert caught.value.code == Code.HUB_CONNECTION_UNRESOLVABLE


def test_the_lists_of_hubs_take_names_and_addresses() -> None:
    check_lists(HUB, "Pioneer Hub", [], ["Other Hub"])
    check_lists(HUB, "Pioneer Hub", ["http://192.168.2.100:6380"], [])
    with pytest.raises(HubError) as barred:
        check_lists(HUB, "Pioneer Hub", ["Pioneer Hub"], ["192.168.2.100:6380"])
    with pytest.raises(HubError) as unlisted:
        check_lists(HUB, "Pioneer Hub", ["Pioneer"], [])
    assert (barred.value.code, unlisted.value.code) == (
        Code.HUB_CONNECTION_BLACKLISTED,
        Code.HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST,
    )


def test_lists_know_all_names_of_an_address() -> None:
    local = HubAddress("127.0.0.1", 6380)
    check_lists(local, "Hub", ["localhost"], [])
    for barred in (["http://localhost:6380"], ["192.168.2.100:6380"]):
        with pytest.raises(HubError):
            check_lists(local, "Hub", [], barred, [HUB])


def test_who_leaves_is_gone_at_once() -> None:
    presence = Presence()
    presence.start({"a", "b"}, 0.0)
    presence.leave("a")
    assert presence.names == {"b"}


def test_who_falls_silent_stays_only_while_links_stand_and_not_for_long() -> None:
    presence = Presence()
    presence.start({"a", "b"}, 0.0)
    presence.expire("a", 1.0)
    presence.expire("b", 1.0)
    assert presence.settle({"b"}, 1.1)
    assert presence.names == {"b"}
    assert not presence.settle({"b"}, 1.0 + Presence.LINKED_GRACE - 0.1)
    assert presence.settle({"b"}, 1.0 + Presence.LINKED_GRACE)
    assert presence.names == frozenset()


def test_a_restarted_hub_gives_everybody_time_to_register() -> None:
    presence = Presence()
    presence.start({"a", "b"}, 0.0)
    presence.start(set(), 10.0)
    assert presence.names == {"a", "b"}
    presence.join("a")
    presence.settle(set(), 10.0 + Presence.RESTART_GRACE)
    assert presence.names == {"a"}
    assert not presence.waiting


def test_who_returns_late_to_a_restarted_hub_stays_longer_if_links_stand() -> None:
    presence = Presence()
    presence.start({"a", "b"}, 0.0)
    presence.start(set(), 10.0)
    late = 10.0 + Presence.RESTART_GRACE
    assert presence.settle({"b"}, late)
    assert presence.names == {"b"}
    assert presence.settle({"b"}, late + Presence.LINKED_GRACE)


def test_a_hub_that_is_restarted_twice_gives_time_twice() -> None:
    """Redis and then the hub were killed: gateways that had joined neither were dropped, although no hub had run."""
    presence = Presence()
    presence.start({"a", "b"}, 0.0)
    presence.start(set(), 10.0)
    presence.start(set(), 20.0)
    assert not presence.settle(set(), 20.1)
    presence.join("a")
    assert presence.names == {"a", "b"}


def test_names_are_the_same_object_while_nobody_comes_or_goes() -> None:
    presence = Presence()
    presence.start({"a", "b"}, 0.0)
    names = presence.names
    presence.join("a")
    assert presence.names is names
    presence.join("c")
    assert presence.names == names | {"c"}


def test_a_name_that_was_never_there_cannot_expire() -> None:
    presence = Presence()
    presence.expire("ghost", 0.0)
    assert presence.names == frozenset()
