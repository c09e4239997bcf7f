"""Redis is open to others only with a password or if the user insists, and stores nothing on disk."""

from pathlib import Path

import pytest

from rocon_hub.config import Guard, HubConfig, is_open, quoted, redis_configuration
from rocon_hub.error import HubNodeError
from rocon_hub.watch import Watch

DIRECTORY = Path("/tmp/a b")


def lines(config: HubConfig, password: bool = False) -> list[str]:
    return redis_configuration(config, DIRECTORY, Guard(password), "admin").splitlines()


def test_without_a_password_only_this_machine_may_connect() -> None:
    assert "bind 127.0.0.1 -::1" in lines(HubConfig())
    assert "protected-mode yes" in lines(HubConfig())


def test_insistence_opens_redis_to_the_network() -> None:
    assert {"bind * -::*", "protected-mode no", "port 6380"} <= set(lines(HubConfig(insecure=True)))


def test_with_a_password_redis_has_no_port() -> None:
    assert "port 0" in lines(HubConfig(), True)
    assert is_open(HubConfig(), Guard(True))


def test_certificates_open_the_hub_to_who_has_one_and_leave_no_plain_port() -> None:
    guard = Guard(False, "/tls/tls.crt", "/a b/tls.key", "/tls/ca.crt")
    text = redis_configuration(HubConfig(port=1234), DIRECTORY, guard, "admin").splitlines()
    assert {
        "bind * -::*",
        "port 0",
        "tls-port 1234",
        "tls-auth-clients yes",
        'tls-key-file "/a b/tls.key"',
    } <= set(text)


def test_nothing_is_saved() -> None:
    text = lines(HubConfig(port=1234))
    assert {"port 1234", 'save ""', "appendonly no", 'dir "/tmp/a b"'} <= set(text)


def test_a_password_cannot_add_a_line() -> None:
    assert quoted('a"b\\c\nd ü') == '"a\\x22b\\x5cc\\x0ad \\xc3\\xbc"'


@pytest.mark.parametrize(
    "values",
    [
        {"name": ""},
        {"port": 0},
        {"max_memory": "much"},
        {"gateway_gone_timeout": 0.0},
        {"name": "a\nb"},
    ],
)
def test_a_value_that_cannot_be_meant_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(HubNodeError):
        HubConfig(**values)


def test_two_hubs_of_one_name_have_two_directories() -> None:
    assert HubConfig(name="Pioneer Hub").directory_name == "pioneer_hub_6380"
    assert HubConfig(name="Pioneer Hub", port=6381).directory_name == "pioneer_hub_6381"


def test_a_gateway_falls_silent_once_and_is_gone_after_the_patience() -> None:
    watch = Watch(30.0)
    assert watch.fallen_silent({"a", "b"}, {"a"}) == {"b"}
    watch.note("b", 0.0)
    assert watch.fallen_silent({"a", "b"}, {"a"}) == set()
    assert watch.gone(29.9) == set()
    assert watch.gone(30.0) == {"b"}


def test_a_gateway_that_comes_back_may_fall_silent_again() -> None:
    watch = Watch(30.0)
    watch.note("a", 0.0)
    assert watch.returned({"a", "b"}) == {"a"}
    watch.fallen_silent({"a"}, {"a"})
    assert watch.returned({"a", "b"}) == set()
    assert watch.gone(100.0) == set()
    assert watch.fallen_silent({"a"}, set()) == {"a"}


def test_a_silent_gateway_that_could_not_be_reported_is_reported_later() -> None:
    watch = Watch(30.0)
    assert watch.fallen_silent({"a", "b"}, set()) == {"a", "b"}
    watch.note("a", 0.0)
    assert watch.fallen_silent({"a", "b"}, set()) == {"b"}
