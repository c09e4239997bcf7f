"""A request changes all its rules, or is refused with the protocol's code and changes nothing."""

import random
import time

import pytest

from rocon_gateway.error import RequestError
from rocon_gateway.rules.matching import ALL
from rocon_gateway.rules.rulebook import MOST_RULES, RuleBook, check_gateway
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule

A, B, C = (Rule(Kind.PUBLISHER, name) for name in ("/a", "/b", "/c"))
EMPTY = RuleBook("mine")


def remote(rule: Rule, gateway: str = "other") -> RemoteRule:
    return RemoteRule(gateway, rule)


def refusal(change, *arguments: object) -> Code:
    with pytest.raises(RequestError) as caught:
        change(*arguments)
    return caught.value.code


def test_unadvertising_one_of_three_leaves_the_other_two() -> None:
    assert EMPTY.advertised([A, B, C]).unadvertised([A]).advertisements.rules == (B, C)


def test_unadvertising_without_a_node_takes_every_node_and_with_one_only_that() -> None:
    of_x, of_y = Rule(Kind.PUBLISHER, "/a", "/x"), Rule(Kind.PUBLISHER, "/a", "/y")
    book = EMPTY.advertised([of_x, of_y, B])
    assert book.unadvertised([A]).advertisements.rules == (B,)
    assert book.unadvertised([of_y]).advertisements.rules == (of_x, B)


def test_an_advertisement_that_exists_or_is_missing_is_refused() -> None:
    assert refusal(EMPTY.advertised([A]).advertised, [B, A]) == Code.ADVERTISEMENT_EXISTS
    assert refusal(EMPTY.advertised, [A, A]) == Code.ADVERTISEMENT_EXISTS
    assert refusal(EMPTY.advertised([A]).unadvertised, [A, B]) == Code.ADVERTISEMENT_NOT_FOUND


def test_advertising_all_replaces_and_ending_it_clears() -> None:
    book = EMPTY.advertised([A]).advertising_all([B])
    assert {rule.name for rule in book.advertisements.rules} == {ALL}
    assert book.advertisements.blacklist == (B,)
    assert refusal(book.advertising_all, []) == Code.ADVERTISEMENT_EXISTS
    assert book.advertising_nothing() == EMPTY


def test_a_flip_or_pull_that_exists_is_refused() -> None:
    assert (
        refusal(EMPTY.added("flip", [remote(A)]).added, "flip", [remote(B), remote(A)])
        == Code.FLIP_RULE_ALREADY_EXISTS
    )
    assert (
        refusal(EMPTY.added("pull", [remote(A)]).added, "pull", [remote(B), remote(A)])
        == Code.PULL_RULE_ALREADY_EXISTS
    )


@pytest.mark.parametrize("name", ["mine", "mine" + "0" * 32])
def test_a_flip_or_pull_with_ourselves_is_refused(name: str) -> None:
    book = RuleBook(name)
    for target in {name, "mine"}:
        assert refusal(book.added, "flip", [remote(A, target)]) == Code.REMOTE_GATEWAY_SELF_IS_NOT
        assert refusal(book.added, "pull", [remote(A, target)]) == Code.REMOTE_GATEWAY_SELF_IS_NOT
        assert refusal(book.with_all, "flip", target, []) == Code.REMOTE_GATEWAY_SELF_IS_NOT
        assert refusal(book.with_all, "pull", target, []) == Code.REMOTE_GATEWAY_SELF_IS_NOT


@pytest.mark.parametrize("name", ["", " ", "ro\nbot", "robot\0", "robot("])
def test_a_text_that_no_gateway_can_be_called_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(RequestError, match="gateway") as caught:
        check_gateway(name, Code.HUB_UNKNOWN_ERROR)
    assert str(caught.value).isprintable()


def test_cancelling_takes_the_rule_of_that_gateway_only_and_nothing_is_no_error() -> None:
    book = EMPTY.added("flip", [remote(A), remote(A, "third"), remote(B)])
    assert book.removed("flip", [remote(A)]).flips.rules == (remote(A, "third"), remote(B))
    assert book.removed("flip", [remote(C)]) == book


def test_a_cancel_without_a_node_takes_every_node() -> None:
    of_x = Rule(Kind.SUBSCRIBER, "/a", "/x")
    book = EMPTY.added("pull", [remote(of_x)])
    assert book.removed("pull", [remote(Rule(Kind.SUBSCRIBER, "/a"))]).pulls.rules == ()
    assert book.removed("pull", [remote(Rule(Kind.SUBSCRIBER, "/a", "/y"))]) == book


def test_flipping_all_replaces_that_gateways_flips_and_its_blacklist_ends_with_it() -> None:
    book = EMPTY.added("flip", [remote(A), remote(B, "third")]).with_all("flip", "other", [C])
    assert remote(A) not in book.flips.rules
    assert remote(B, "third") in book.flips.rules
    everything = remote(Rule(Kind.PUBLISHER, ALL))
    assert book.flips.excluded(everything) == (C,)
    assert book.flips.excluded(remote(A)) == ()
    assert book.blacklist == ()
    assert refusal(book.with_all, "flip", "other", []) == Code.FLIP_RULE_ALREADY_EXISTS
    ended = book.without("flip", "other")
    assert ended.flips.rules == (remote(B, "third"),)
    assert ended.flips.excluded(everything) == ()


def test_pulling_all_twice_answers_the_code_of_flips() -> None:
    assert (
        refusal(EMPTY.with_all("pull", "other", []).with_all, "pull", "other", [])
        == Code.FLIP_RULE_ALREADY_EXISTS
    )


def test_a_plain_name_on_the_blacklist_is_refused_with_the_rule() -> None:
    book = RuleBook("mine", (Rule(Kind.PUBLISHER, "/rosout.*"),))
    barred = Rule(Kind.PUBLISHER, "/rosout")
    with pytest.raises(RequestError, match=r"blacklisted by publisher /rosout\.\*"):
        book.added("flip", [remote(A), remote(barred)])
    assert refusal(book.advertised, [barred]) == Code.UNKNOWN_ADVERTISEMENT_ERROR
    assert (
        refusal(book.added, "flip", [remote(Rule(Kind.PUBLISHER, "rosout"))])
        == Code.HUB_UNKNOWN_ERROR
    )
    assert book.added("flip", [remote(Rule(Kind.SUBSCRIBER, "/rosout"))]).flips.rules
    assert book.added("flip", [remote(Rule(Kind.PUBLISHER, ALL))]).flips.rules


def test_the_number_of_rules_is_limited() -> None:
    """Each rule costs memory and a row of `~rules`, and any client of the master can add some."""
    book = RuleBook("base")
    many = [RemoteRule("robot", Rule(Kind.PUBLISHER, f"/t{n}")) for n in range(MOST_RULES)]
    rules = [remote.rule for remote in many]
    for action in ("flip", "pull"):
        full = book.added(action, many)
        with pytest.raises(RequestError, match="cancel some first"):
            full.added(action, [RemoteRule("other", rules[0])])
        with pytest.raises(RequestError, match="cancel some first"):
            full.with_all(action, "other", ())
        assert full.without(action, "robot").added(action, many[:1])
    with pytest.raises(RequestError, match="cancel some first"):
        book.advertised(rules).advertised([Rule(Kind.SERVICE, "/s")])


def means(asked: Rule, rule: Rule) -> bool:
    """Returns whether cancelling one rule cancels another one."""
    return asked == rule or (not asked.node and (asked.kind, asked.name) == (rule.kind, rule.name))


@pytest.mark.parametrize("seed", range(30))
def test_cancelling_drawn_rules_leaves_those_that_none_of_them_means(seed: int) -> None:
    drawn = random.Random(seed)
    rules = [
        Rule(kind, name, node)
        for kind in (Kind.PUBLISHER, Kind.SUBSCRIBER)
        for name in ("/a", "/b", "/c")
        for node in ("", "/x", "/y")
    ]
    remotes = [remote(rule, gateway) for rule in rules for gateway in ("other", "third")]
    known, cancelled = (tuple(drawn.sample(remotes, drawn.randrange(20))) for _ in range(2))
    kept = [
        one
        for one in known
        if not any(
            one.gateway == other.gateway and means(other.rule, one.rule) for other in cancelled
        )
    ]
    book = EMPTY.added("flip", known).removed("flip", cancelled)
    assert book.flips.rules == tuple(kept)

    known_rules, asked = (drawn.sample(rules, drawn.randrange(9)) for _ in range(2))
    left = known_rules
    is_refused = False
    for rule in asked:
        is_refused = is_refused or not any(means(rule, one) for one in left)
        left = [one for one in left if not means(rule, one)]
    advertising = EMPTY.advertised(known_rules)
    if is_refused:
        assert refusal(advertising.unadvertised, asked) == Code.ADVERTISEMENT_NOT_FOUND
    else:
        assert advertising.unadvertised(asked).advertisements.rules == tuple(left)


def test_a_full_book_is_filled_and_emptied_in_far_less_than_a_second() -> None:
    """Cancelling 3,500 rules compared each with each and took more than ten seconds."""
    rules = [Rule(Kind.PUBLISHER, f"/pioneer{number}/scan") for number in range(MOST_RULES)]
    remotes = [remote(rule) for rule in rules]
    began = time.process_time()
    book = EMPTY.advertised(rules).added("flip", remotes).added("pull", remotes)
    book = book.unadvertised(rules).removed("flip", remotes).removed("pull", remotes)
    assert time.process_time() - began < 1.0
    assert book == EMPTY
