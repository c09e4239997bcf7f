"""Records that gateways write on the hub are read back unchanged; invalid records do no harm."""

import dataclasses

import pytest

from rocon_hub_protocol.record import (
    Offer,
    PeerRequest,
    Purpose,
    Record,
    RecordError,
    Reply,
    Want,
    record_from_text,
    request_from_text,
    text_from_record,
    text_from_request,
)
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule

RECORD = Record(
    name="aadi1_gateway",
    instance="i",
    host="192.168.2.101",
    port=40000,
    firewall=True,
    advertisements=(Connection(Kind.PUBLISHER, "/tf", "tf2_msgs/TFMessage", "/amcl"),),
    flips=(RemoteRule("Hub_Gateway", Rule(Kind.SUBSCRIBER, "/odom", "")),),
    pulls=(RemoteRule("Hub_Gateway", Rule(Kind.PUBLISHER, "/clock", "/gazebo")),),
)
REQUEST = PeerRequest(
    (
        Offer("/a", "std_msgs/String", "/talker", Purpose.FLIP),
        Offer("/b", "x/Y", "/n", Purpose.PULL, "/listener"),
    ),
    (Want("/odom", "/amcl", Purpose.FLIP),),
    (Reply(Kind.PUBLISHER, "/a", "/talker", "active", "wörds"),),
)


def test_a_record_survives_the_hub() -> None:
    assert record_from_text(text_from_record(RECORD)) == RECORD


def test_a_request_survives_the_hub() -> None:
    assert request_from_text(text_from_request(REQUEST)) == REQUEST


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nothing",
        "[]",
        "{}",
        b"\xff\xfe",
        "[" * 100000,
        text_from_record(RECORD).replace("40000", "true"),
        text_from_record(RECORD).replace("40000", '"40000"'),
        text_from_record(RECORD).replace('"publisher"', '"topic"'),
        text_from_record(RECORD).replace('"/clock"', "1"),
        text_from_record(RECORD).replace('"/clock",', ""),
    ],
)
def test_a_bad_record_is_an_error_of_ours(text: str | bytes) -> None:
    with pytest.raises(RecordError):
        record_from_text(text)


LONG = "/" + "a/" * 500_000


@pytest.mark.parametrize("name", [LONG, "/a b", "/\x00", "", "/é", "9lives", "/a\n"])
def test_an_invalid_or_too_long_name_is_skipped_and_the_rest_is_read(name: str) -> None:
    """A member that advertised a name of 1 MB once stalled every gateway with a pull such as `.*/move_base/.*`."""
    bad = Connection(Kind.PUBLISHER, name, "std_msgs/String", "/talker")
    record = dataclasses.replace(RECORD, advertisements=(bad, *RECORD.advertisements))
    assert record_from_text(text_from_record(record)) == RECORD
    request = PeerRequest(
        (Offer(name, "x/Y", "/n", Purpose.FLIP), *REQUEST.offers), REQUEST.wants, REQUEST.replies
    )
    request = dataclasses.replace(
        request, wants=(Want(name, "/amcl", Purpose.FLIP), *REQUEST.wants)
    )
    assert request_from_text(text_from_request(request)) == REQUEST


@pytest.mark.parametrize("name", [LONG, ""])
def test_a_gateway_whose_name_is_too_long_is_not_read(name: str) -> None:
    with pytest.raises(RecordError):
        record_from_text(text_from_record(dataclasses.replace(RECORD, name=name)))


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        '{"offers":{},"wants":[],"replies":[]}',
        '{"offers":[],"wants":[["/a","","x"]],"replies":[]}',
    ],
)
def test_a_bad_request_is_an_error_of_ours(text: str) -> None:
    with pytest.raises(RecordError):
        request_from_text(text)
