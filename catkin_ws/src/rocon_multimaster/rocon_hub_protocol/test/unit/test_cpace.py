"""CPace, checked against the draft's own test vectors and against cheating peers."""

import pytest

from rocon_hub_protocol.cpace import Exchange, ProofError, generator

SESSION = bytes.fromhex("7e4b4791d6a8ef019b936c79fb7f2c57")


def test_the_generator_is_that_of_the_drafts_test_vector() -> None:
    channel = bytes.fromhex("6f630b425f726573706f6e6465720b415f696e69746961746f72")
    expected = "64e8099e3ea682cfdc5cb665c057ebb514d06bf23ebc9f743b51b82242327074"
    assert generator(b"Password", channel, SESSION).hex() == expected


def exchanged(ours: str, theirs: str) -> tuple[tuple[bytes, bytes], tuple[bytes, bytes]]:
    first, second = Exchange(ours, b"test", SESSION), Exchange(theirs, b"test", SESSION)
    return first.tags(first.share, second.share), second.tags(first.share, second.share)


@pytest.mark.parametrize("password", ["open sesame", "ü" * 300, "x" * 127])
def test_both_sides_of_one_password_find_the_same_tags(password: str) -> None:
    first, second = exchanged(password, password)
    assert first == second
    assert first[0] != first[1]


def test_different_passwords_give_different_tags_and_shares_never_repeat() -> None:
    first, second = exchanged("open sesame", "open barley")
    assert not set(first) & set(second)
    assert Exchange("a", b"test", SESSION).share != Exchange("a", b"test", SESSION).share


@pytest.mark.parametrize(
    "share", [bytes(32), b"", bytes(31), (1).to_bytes(32, "little"), b"\xff" * 33]
)
def test_a_share_that_would_fix_the_outcome_is_refused(share: bytes) -> None:
    exchange = Exchange("open sesame", b"test", SESSION)
    with pytest.raises(ProofError):
        exchange.tags(exchange.share, share)


def test_our_own_share_sent_back_is_refused() -> None:
    exchange = Exchange("open sesame", b"test", SESSION)
    with pytest.raises(ProofError):
        exchange.tags(exchange.share, exchange.share)
