"""What is said of a rule when several things are to be said of it."""

from rocon_gateway.rules import verdict
from rocon_gateway.rules.situation import State, Verdict
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule

ACTION = Connection(Kind.ACTION_CLIENT, "/move_base", "/client", "http://10.0.0.1:1/")
FLIP = RemoteRule("robot", Rule(Kind.SUBSCRIBER, "/scan", "/a"))


def test_a_topic_that_works_in_small_segments_hides_no_fault_of_the_action() -> None:
    fault = Verdict(State.TYPE_MISMATCH, "md5")
    topics = [
        (Kind.PUBLISHER, Verdict(State.MTU, "advice")),
        (Kind.PUBLISHER, Verdict(State.RATE_LIMITED)),
        (Kind.SUBSCRIBER, fault),
    ]
    assert verdict.of_action(ACTION, "there", topics) == fault
    assert verdict.of_action(ACTION, "there", topics[:1]).state == State.MTU


def test_advice_and_the_nodes_that_no_flip_covers_are_both_said() -> None:
    for state in (State.ACTIVE, State.MTU):
        said = verdict.for_node(
            lambda state=state: Verdict(state, "advice"), "/scan", FLIP, True, ["/b"]
        )
        assert said.state == state
        assert said.reason.startswith("advice; only for /a")
        assert verdict.UNCOVERED in said.reason
