"""Tokens are exchanged for sessions that expire; origins must match exactly."""

import itertools

import pytest

from pioneer_web.access.access_control import MOST_SESSIONS, Access, Role, same_origin

TOKENS = {Role.OPERATOR: "operators-token", Role.VIEWER: "viewers-token"}


@pytest.fixture
def access():
    return Access(TOKENS, 100.0, map(str, itertools.count()).__next__)


def test_each_token_gives_its_role_until_the_session_expires(access):
    for role, token in TOKENS.items():
        session = access.login(token, 5.0)
        assert access.role(session, 104.9) is role
        assert access.role(session, 105.0) is None


def test_unknown_tokens_and_sessions_give_nothing(access):
    assert access.login("", 0.0) is None
    assert access.login("operators-toke", 0.0) is None
    assert access.login("öperators-token", 0.0) is None
    assert access.role("7", 0.0) is None


def test_a_session_ends_by_logout_and_by_too_many_newer_ones(access):
    first = access.login("viewers-token", 0.0)
    second = access.login("viewers-token", 0.0)
    access.logout(second)
    assert access.role(second, 1.0) is None
    for _ in range(MOST_SESSIONS):
        access.login("viewers-token", 0.0)
    assert access.role(first, 1.0) is None


@pytest.mark.parametrize(
    ("origin", "encrypted", "same"),
    [
        ("", False, True),
        ("http://127.0.0.1:8090", False, True),
        ("https://127.0.0.1:8090", False, False),
        ("https://127.0.0.1:8090", True, True),
        ("http://127.0.0.1:8091", False, False),
        ("http://127.0.0.1:8090.evil.example", False, False),
        ("null", False, False),
    ],
)
def test_only_the_pages_own_origin_is_the_same(origin, encrypted, same):
    assert same_origin(origin, "127.0.0.1:8090", encrypted) is same
