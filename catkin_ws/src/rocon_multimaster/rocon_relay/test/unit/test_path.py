"""The segment sizes for paths that swallow large packets."""

import pytest

from rocon_relay.connection import Address
from rocon_relay.link import Hello, probe_from_field
from rocon_relay.path import FORGET, FULL, MAX_PROBE, SEGMENTS, Choice, Paths, advice

FAR = Address("robot", 4000)
OTHER = Address("other", 4000)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_each_loss_of_full_packets_makes_the_segments_of_that_path_smaller() -> None:
    paths = Paths(Clock())
    for size in SEGMENTS:
        assert paths.choice(FAR).segment == size
        paths.swallows(FAR, size, is_proved=True)
    assert paths.choice(FAR) == FULL, "then the full size is tried again"
    assert paths.choice(OTHER) == FULL


def test_several_links_that_fail_together_count_once() -> None:
    paths = Paths(Clock())
    for _ in range(5):
        paths.swallows(FAR, 0, is_proved=True)
    assert paths.choice(FAR) == Choice(SEGMENTS[1], proved=SEGMENTS[1])


def test_a_guess_says_so_and_a_later_proof_replaces_it() -> None:
    paths = Paths(Clock())
    paths.swallows(FAR, 0, is_proved=False)
    guess = paths.choice(FAR)
    assert guess == Choice(SEGMENTS[1], proved=0)
    assert not guess.is_proved
    assert "the other gateway was busy, or" in advice(guess)
    assert "set the MTU" not in advice(guess)
    paths.swallows(FAR, SEGMENTS[1], is_proved=True)
    assert paths.choice(FAR) == Choice(SEGMENTS[2], proved=SEGMENTS[2])


def test_a_proof_for_full_packets_proves_nothing_for_smaller_ones() -> None:
    """A frozen gateway once made a path with an MTU of 1240 advise to set its MTU to 540."""
    paths = Paths(Clock())
    paths.swallows(FAR, 0, is_proved=True)
    paths.swallows(FAR, SEGMENTS[1], is_proved=False)
    choice = paths.choice(FAR)
    assert choice == Choice(SEGMENTS[2], proved=SEGMENTS[1])
    assert choice.is_proved, "full packets still vanish"
    assert "mtu 1240)" in advice(choice)
    assert "the other gateway was busy, or" in advice(choice)
    assert "mtu 540" not in advice(choice)


def test_a_path_is_tried_with_full_segments_again_after_some_time() -> None:
    clock = Clock()
    paths = Paths(clock)
    paths.swallows(FAR, 0, is_proved=True)
    clock.now = FORGET
    assert paths.choice(FAR).segment == SEGMENTS[1]
    clock.now = FORGET + 1.0
    assert paths.choice(FAR) == FULL


def test_the_advice_names_the_mtu() -> None:
    assert advice(FULL) == ""
    assert "mtu 1240" in advice(Choice(1200, proved=1200))


@pytest.mark.parametrize("text", ["", "x", "-1", "²", "1e3", str(MAX_PROBE + 1), "9" * 5000])
def test_an_invalid_probe_is_none(text: str) -> None:
    assert probe_from_field(text) == 0


def test_a_probe_is_part_of_the_hello() -> None:
    hello = Hello("/t", "*", "*", "/n", "a", "b", ("b",), "n", probe=1716)
    assert Hello.from_fields(hello.fields()).probe == 1716
    assert "probe" not in Hello("/t", "*", "*", "/n", "a", "b", ("b",), "n").fields()
