"""Any input from outside is understood or refused with a typed error; no other exception is ever raised."""

import pytest
from gateway_model import gateway, publisher
from gateway_msgs import msg
from hypothesis import given
from hypothesis import strategies as st
from nonsense import hellos, kinds, records, requests, texts

from rocon_gateway.error import RequestError
from rocon_gateway.rules import conversions
from rocon_gateway.rules.matching import rule_matches
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.situation import Remote, Situation
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.record import (
    PeerRequest,
    Record,
    RecordError,
    record_from_text,
    request_from_text,
    text_from_record,
    text_from_request,
)
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule
from rocon_relay.connection import RelayError
from rocon_relay.link import Hello
from rocon_relay.option import LinkOptions

# Patterns may cause warnings, e.g. for nested sets or flags in the middle.
pytestmark = pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")


@given(records)
def test_a_hostile_record_is_read_as_it_will_be_written_or_refused(text: bytes) -> None:
    try:
        record = record_from_text(text)
    except RecordError:
        return
    assert record_from_text(text_from_record(record)) == record


@given(requests)
def test_a_hostile_request_is_read_as_it_will_be_written_or_refused(text: bytes) -> None:
    try:
        request = request_from_text(text)
    except RecordError:
        return
    assert request_from_text(text_from_request(request)) == request


@given(records, requests, st.booleans())
def test_no_record_or_request_stops_the_comparison_or_takes_what_was_not_given(
    record: bytes, request: bytes, firewall: bool
) -> None:
    own = gateway(
        "base", publisher("/flow", "/node"), publisher("/kept", "/node"), firewall=firewall
    )
    rules = [
        RemoteRule("robot", Rule(kind, name))
        for kind in Kind
        if kind != Kind.PARAMETER
        for name in ("/f.*", ".*")
    ]
    book = (
        own.book.advertised([Rule(Kind.PUBLISHER, "/flow")])
        .added("flip", rules[:2])
        .added("pull", rules)
    )
    situation = Situation(
        book=book,
        firewall=firewall,
        local=frozenset(own.local),
        connected=True,
        names=frozenset({"robot"}),
        remotes={
            "robot": Remote(
                _sound(record, record_from_text, RECORD),
                _sound(request, request_from_text, PeerRequest()),
            )
        },
        namespace="base",
    )
    outcome = reconcile(situation)
    assert reconcile(situation) == outcome
    assert {one.to_gateway for one in outcome.exports} <= {"robot"}
    text_from_request(outcome.requests.get("robot", PeerRequest())).encode()


RECORD = Record("robot", "i", "127.0.0.1", 4000)


def _sound(text, parse, otherwise):
    try:
        return parse(text)
    except RecordError:
        return otherwise


@given(hellos)
def test_any_hello_is_understood_or_refused(fields: dict[str, str]) -> None:
    try:
        hello = Hello.from_fields(fields)
    except RelayError:
        return
    assert isinstance(hello.options, LinkOptions)
    assert Hello.from_fields(hello.fields()) == hello


patterns = texts | st.text("ab/.*+?()[]{}|\\^$,1", max_size=12)


@given(kinds, patterns, patterns, patterns)
def test_a_rule_is_sound_or_refused_with_the_callers_code(
    kind: str, name: str, node: str, target: str
) -> None:
    message = msg.RemoteRule(target, msg.Rule(kind, name, node))
    try:
        (remote,) = conversions.remote_rules_from_messages([message], Code.HUB_UNKNOWN_ERROR)
    except RequestError as error:
        refused = error.code
    else:
        refused = Code.SUCCESS
    if refused != Code.SUCCESS:
        assert refused == Code.HUB_UNKNOWN_ERROR
        return
    assert (remote.rule.name, remote.rule.node) == (name, node)
    assert rule_matches(remote.rule, publisher("/a/b", "/ab"), "own") in (True, False)
