"""Which gateways are on which of several hubs, combined."""

from rocon_gateway.hub.membership import Memberships
from rocon_gateway.hub.presence import HubView
from rocon_gateway.rules.situation import Remote
from rocon_hub_protocol.record import Record


def remote(name: str, host: str) -> Remote:
    return Remote(Record(name, "i", host, 1))


def view(
    host: str, *names: str, connected: bool = True, listed: tuple[str, ...] | None = None
) -> HubView:
    told = {name: remote(name, host) for name in names}
    present = frozenset(names)
    return HubView(
        connected, host, host, "", present if listed is None else frozenset(listed), present, told
    )


def test_a_gateway_on_two_hubs_is_one_remote_and_keeps_its_way() -> None:
    both = Memberships()
    both.take("b", view("by b", "robot"))
    seen = both.take("a", view("by a", "robot", "other"))
    assert seen.names == {"robot", "other"}
    assert {name: one.record.host for name, one in seen.remotes.items()} == {
        "robot": "by b",
        "other": "by a",
    }
    assert both.take("b", view("by b", "robot")).remotes["robot"].record.host == "by b"


def test_what_the_only_hub_reports_is_handed_on_as_it_is() -> None:
    reported = view("by a", "robot", "other")
    seen = Memberships().take("a", reported)
    assert seen.names is reported.names
    assert seen.remotes is reported.remotes


def test_losing_one_hub_changes_nothing_for_who_is_on_another() -> None:
    both = Memberships()
    both.take("a", view("by a", "robot", "only a"))
    before = both.take("b", view("by b", "robot"))
    after = both.take("a", view("by a", "robot", "only a", connected=False))
    assert after.names == before.names
    assert after.connected
    assert after.remotes["robot"].record.host == "by b"
    assert both.take("b", view("by b", "robot", connected=False)).names == before.names


def test_who_left_the_last_hub_is_not_kept_by_one_that_was_lost_before() -> None:
    both = Memberships()
    both.take("a", view("by a", "robot", connected=False))
    both.take("b", view("by b", "robot"))
    assert both.take("b", view("by b")).names == frozenset()


def test_a_hub_that_lists_a_gateway_goes_before_one_that_only_retains_it() -> None:
    both = Memberships()
    both.take("a", view("by a", "robot"))
    both.take("b", view("by b", "robot"))
    assert both.take("a", view("by a", "robot", listed=())).remotes["robot"].record.host == "by b"


def test_a_hub_that_is_given_up_takes_along_what_only_it_knew() -> None:
    both = Memberships()
    both.take("a", view("by a", "robot", connected=False))
    both.take("b", view("by b", "other"))
    assert both.drop("a").names == {"other"}


def test_we_are_on_a_hub_once_the_overview_has_it_and_until_it_is_lost_or_given_up() -> None:
    """`connect_hub` once reported that a hub was joined before `gateway_info` showed it."""
    both = Memberships()
    assert not both.is_on("a")
    assert both.take("a", view("by a")).connected
    assert both.is_on("a")
    assert not both.is_on("b")
    both.take("a", view("by a", connected=False))
    assert not both.is_on("a")
    both.take("b", view("by b"))
    both.drop("b")
    assert not both.is_on("b")
