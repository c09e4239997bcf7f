"""A thousand unrelated gateways on a hub cost a gateway nothing, as long as none joins or leaves."""

import difflib

import pytest
from gateway_model import gateway, to
from hypothesis import given
from hypothesis import strategies as st

from rocon_gateway.rules import matching as rule
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.situation import Situation, State
from rocon_gateway.rules.spelling import Spelling
from rocon_hub_protocol.rule import Kind

NAMES = [f"crowd{number}" for number in range(1000)]
names = st.text("abc12", max_size=6)


class Count:
    """Counts the calls of a function."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, owner: object, name: str) -> None:
        function, self.calls = getattr(owner, name), 0

        def counted(*arguments: object) -> object:
            self.calls += 1
            return function(*arguments)

        monkeypatch.setattr(owner, name, counted)


def situation(*gateways: str, also: str = "crowd") -> Situation:
    own = gateway("base")
    book = own.book.added("flip", [to(one, Kind.PUBLISHER, "/flow") for one in gateways])
    return Situation(
        book=book,
        firewall=False,
        local=frozenset(),
        connected=True,
        names=frozenset([*NAMES, also]),
    )


def test_whom_rules_mean_is_looked_for_when_a_gateway_joins_or_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rules = [f"{one}[0-9]" for one in ("crowd99", "absent", "c.*")]
    reconcile(situation(*rules))
    count = Count(monkeypatch, rule, "matches_whole")
    reconcile(situation(*rules))
    assert count.calls == 0
    (first, *_) = reconcile(situation(*rules, also="absent1")).states
    assert count.calls >= len(NAMES)
    assert first.verdict.state == State.PENDING


def test_the_nearest_names_are_looked_for_among_newcomers_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = reconcile(situation("crowd5000", "robot5000"))
    count = Count(monkeypatch, difflib.SequenceMatcher, "set_seq1")
    assert reconcile(situation("crowd5000", "robot5000")).states == before.states
    assert count.calls == 0
    near, _ = reconcile(situation("crowd5000", "robot5000", also="crowd50001")).states
    assert count.calls == 2
    assert near.verdict.reason.startswith("nearest on the hub: crowd50001, crowd500")


@given(names, st.lists(st.sets(names)))
def test_the_nearest_names_are_those_of_difflib_whatever_was_asked_before(
    name: str, asked: list[set[str]]
) -> None:
    spelling = Spelling(name)
    for known in asked:
        assert spelling.nearest(frozenset(known)) == difflib.get_close_matches(
            name, sorted(known), n=3
        )
