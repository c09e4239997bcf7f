"""The requests sent to a gateway, given its current rules, and how its answers are interpreted."""

import logging

import pytest
import rospy
from gateway_msgs import msg

from rocon_flip.gateway_client import GatewayClient
from rocon_flip.rule_set import Action, Wish

FIRST, SECOND = (Wish("publisher", f"/{name}", "", "Hub_Gateway") for name in ("one", "two"))


class Gateway:
    """Answers each call with the next of ``answers``, or with success once there are none left."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, list[str], bool]] = []
        self.answers: list[int] = []
        self.fails = False

    def proxy(self, name: str, kind: type):
        def call(cancel, remotes=(), rules=()):
            if self.fails:
                raise rospy.ServiceException("gone")
            self.calls.append(
                (name, [one.name for one in rules] or [one.rule.name for one in remotes], cancel)
            )
            result = self.answers.pop(0) if self.answers else msg.ErrorCodes.SUCCESS
            return kind._response_class(result=result, error_message="a reason" if result else "")

        return call


@pytest.fixture
def gateway(monkeypatch):
    fake = Gateway()
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "wait_for_service", lambda _name: None)
    monkeypatch.setattr(rospy, "ServiceProxy", fake.proxy)
    return fake


@pytest.fixture
def client(gateway):
    return GatewayClient("/gateway")


def info(**lists) -> msg.GatewayInfo:
    return msg.GatewayInfo(connected=True, **lists)


def rule_of(wish: Wish) -> msg.Rule:
    return msg.Rule(wish.kind, wish.name, wish.node)


def test_all_rules_are_asked_for_in_one_call(gateway, client) -> None:
    assert client.ask(Action.FLIP, [FIRST, SECOND])
    assert gateway.calls == [("/gateway/flip", ["/one", "/two"], False)]
    assert client.ask(Action.ADVERTISE, [Wish("publisher", "/map")])
    assert gateway.calls[1:] == [("/gateway/advertise", ["/map"], False)]


@pytest.mark.parametrize(
    ("action", "field"),
    [(Action.FLIP, "flip_watchlist"), (Action.PULL, "pull_watchlist")],
)
def test_a_rule_that_the_gateway_has_is_not_asked_for_again(gateway, client, action, field) -> None:
    client._take(info(**{field: [msg.RemoteRule(FIRST.gateway, rule_of(FIRST))]}))
    assert client.ask(action, [FIRST, SECOND])
    assert gateway.calls == [(f"/gateway/{action}", ["/two"], False)]
    assert client.ask(action, [FIRST])
    assert len(gateway.calls) == 1


def test_what_is_advertised_is_not_advertised_again(gateway, client) -> None:
    wish = Wish("publisher", "/map")
    client._take(info(public_watchlist=[rule_of(wish)]))
    assert client.ask(Action.ADVERTISE, [wish])
    assert gateway.calls == []


def test_a_rule_is_taken_back_whether_the_gateway_has_listed_it_or_not(gateway, client) -> None:
    client._take(info(flip_watchlist=[msg.RemoteRule(FIRST.gateway, rule_of(FIRST))]))
    assert client.ask(Action.FLIP, [FIRST, SECOND], cancel=True)
    assert gateway.calls == [("/gateway/flip", ["/one", "/two"], True)]


def test_of_several_rules_one_that_exists_does_not_stop_the_others(gateway, client) -> None:
    exists = msg.ErrorCodes.FLIP_RULE_ALREADY_EXISTS
    gateway.answers = [exists, exists, msg.ErrorCodes.SUCCESS]
    assert client.ask(Action.FLIP, [FIRST, SECOND])
    assert [names for _, names, _ in gateway.calls] == [["/one", "/two"], ["/one"], ["/two"]]


def test_a_refusal_is_logged_with_its_reason(gateway, client, caplog) -> None:
    gateway.answers = [19]
    with caplog.at_level(logging.ERROR, "rosout"):
        assert not client.ask(Action.FLIP, [FIRST])
    assert "Flip: a reason" in caplog.text


def test_a_gateway_that_ends_meanwhile_is_a_refusal(gateway, client) -> None:
    gateway.fails = True
    assert not client.ask(Action.PULL, [FIRST])


def test_waiting_ends_once_the_gateway_is_on_a_hub(gateway, client) -> None:
    client._take(info())
    client.wait()


def test_waiting_ends_with_the_node(gateway, client, monkeypatch) -> None:
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    client._take(msg.GatewayInfo(connected=False))
    with pytest.raises(rospy.ROSInterruptException):
        client.wait()
