"""What gateways write on the hub comes back as it went, and what strangers write does no harm."""

import pytest

from rocon_hub_protocol.core.record import (
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
from rocon_hub_protocol.core.rule import Connection, Kind, RemoteRule, Rule

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
    (Offer("/a", "std_msgs/String", "/talker", Purpose.FLIP), Offer("/b", "x/Y", "/n", Purpose.PULL, "/listener")),
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


@pytest.mark.parametrize(
    "text", ["{}", '{"offers":{},"wants":[],"replies":[]}', '{"offers":[],"wants":[["/a","","x"]],"replies":[]}']
)
def test_a_bad_request_is_an_error_of_ours(text: str) -> None:
    with pytest.raises(RecordError):
        request_from_text(text)
