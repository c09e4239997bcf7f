"""Rings, periods, and message routing."""

from dataclasses import dataclass

import pytest

from pioneer_gazebo.lockstep.gate import _ring_names
from pioneer_gazebo.lockstep.lockstep import Lockstep


@dataclass(frozen=True)
class Sent:
    """A message."""

    sender: str
    topic: str
    number: int = 0


@pytest.fixture
def state() -> Lockstep:
    """Returns a state with two rings that have joined."""
    state = Lockstep()
    state.expect(["b", "a"])
    state.subscribe(["/a/command", "/b/command"])
    assert state.join("a", ["/a/one", "/a/two"], ["/a/scan", "/a/goal", "/tf"])
    assert state.join("b", ["/b/one"], ["/b/scan", "/tf"])
    return state


def test_the_first_period_waits_for_every_expected_ring() -> None:
    state = Lockstep()
    state.expect(["b", "a"])
    state.join("b", ["/b/one"], [])
    assert [ring.name for ring in state.absent] == ["a"]
    assert not state.join("b", ["/b/one"], []), "a second answer changes nothing"


def test_a_token_has_what_its_ring_subscribes_to(state: Lockstep) -> None:
    scans = [Sent("/gazebo", "/a/scan"), Sent("/gazebo", "/b/scan"), Sent("/gazebo", "/tf")]
    rounds = {ring.name: messages for ring, messages in state.begin_period(scans)}
    assert rounds == {"a": [scans[0], scans[2]], "b": [scans[1], scans[2]]}


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
def test_the_order_in_which_tokens_return_changes_nothing(
    state: Lockstep, order: tuple[str, str]
) -> None:
    state.begin_period([])
    sent = {
        "a": [Sent("/a/one", "/tf"), Sent("/a/two", "/a/command"), Sent("/a/two", "/a/goal")],
        "b": [Sent("/b/one", "/tf", 2), Sent("/b/one", "/b/command")],
    }
    assert [state.take(name, 1, sent[name]) for name in order] == [False, True]
    assert state.end_period() == [sent["a"][1], sent["b"][1]]
    rounds = {ring.name: messages for ring, messages in state.begin_period([])}
    assert rounds == {
        "a": [sent["a"][0], sent["a"][2], sent["b"][0]],
        "b": [sent["b"][0], sent["a"][0]],
    }


def test_a_token_of_another_period_is_not_taken(state: Lockstep) -> None:
    state.begin_period([])
    assert not state.take("a", 0, [])
    assert [ring.name for ring in state.late] == ["a", "b"]


def test_a_dropped_ring_is_waited_for_no_more_and_may_join_again(state: Lockstep) -> None:
    state.begin_period([])
    state.take("b", 1, [])
    state.drop(state.rings["a"])
    assert not state.late
    state.end_period()
    assert [ring.name for ring, _ in state.begin_period([])] == ["b"]
    assert state.join("a", ["/a/one"], [])
    assert not any(ring.told for ring in state.rings.values()), (
        "everybody gets the list of members again"
    )
    state.take("b", 2, [])
    assert [ring.name for ring, _ in state.begin_period([])] == ["a", "b"]


def test_time_waits_for_nobody_once_no_ring_takes_part_any_more(state: Lockstep) -> None:
    assert Lockstep().stands, "before the first period, rings are not known yet"
    state.begin_period([])
    for ring in ("a", "b"):
        state.take(ring, 1, [])
    state.end_period()
    state.expect([])
    assert not state.stands
    assert state.begin_period([]) == []
    assert not state.stands
    state.expect(["a"])
    assert state.stands, "until it has joined"


def test_the_ring_without_a_namespace_has_a_name() -> None:
    assert _ring_names(" / a /b ") == ["", "a", "b"]


def test_a_ring_that_is_no_longer_expected_leaves_and_time_waits_for_it_once_it_is_expected_again(
    state: Lockstep,
) -> None:
    state.begin_period([])
    state.take("a", 1, [Sent("/a/one", "/tf")])
    state.take("b", 1, [])
    state.end_period()
    state.expect(["b"])
    assert not state.stands
    assert not state.join("a", ["/a/one"], []), "it is not asked"
    assert [ring.name for ring, _ in state.begin_period([])] == ["b"]
    state.take("b", 2, [])
    state.expect(["a", "b"])
    assert state.stands
    assert [ring.name for ring in state.absent] == ["a"]
    assert state.join("a", ["/a/one"], ["/tf"])
    assert not state.stands


def test_withheld_topics_and_rings_get_and_give_nothing_but_what_is_their_own(
    state: Lockstep,
) -> None:
    state.withheld = frozenset({"a", "/b/scan"})
    own = [Sent("/gazebo", "/a/scan"), Sent("/gazebo", "/b/scan"), Sent("/gazebo", "/tf")]
    rounds = {ring.name: messages for ring, messages in state.begin_period(own)}
    assert rounds == {"a": [], "b": [own[2]]}
    goal = Sent("/a/two", "/a/goal")
    state.take("a", 1, [goal, Sent("/a/two", "/tf"), Sent("/a/two", "/a/command")])
    state.take("b", 1, [Sent("/b/one", "/tf")])
    assert state.end_period() == []
    assert {ring.name: ring.kept for ring in state.rings.values()} == {
        "a": [goal, Sent("/a/two", "/tf")],
        "b": [Sent("/b/one", "/tf")],
    }
