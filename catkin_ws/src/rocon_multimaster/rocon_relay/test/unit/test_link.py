import dataclasses

import pytest

from rocon_relay.connection import ANY, LinkState, is_proxy_uri, proxy_name, proxy_uri
from rocon_relay.link import Hello, LinkError, is_proof, mismatch, proof, state_from_field
from rocon_relay.option import LinkOptions
from tcpros.header import header_bytes, header_fields

HELLO = Hello(
    "/scan",
    "sensor_msgs/LaserScan",
    ANY,
    "/laser",
    "robot",
    "base",
    ("base",),
    "00ff",
    keys=("k1", "k2"),
)


def test_a_hello_is_read_as_it_was_written():
    assert Hello.from_fields(header_fields(header_bytes(HELLO.fields())[4:])) == HELLO


def test_a_hello_with_whole_rates_is_written_alike_on_both_sides():
    """The proof covers its bytes: a rate of 20 that came back as 20.0 once made every password differ."""
    hello = dataclasses.replace(HELLO, options=LinkOptions(rate=20, stamp_rate=20))
    assert Hello.from_fields(hello.fields()).fields() == hello.fields()


@pytest.mark.parametrize("names", [("a,b",), ("a%2Cb", "c%"), (",", "%"), ("base",), ()])
def test_names_of_gateways_with_commas_stay_whole(names):
    """A loop over a gateway whose name holds a comma was not recognised."""
    hello = dataclasses.replace(HELLO, gateways_passed=names)
    assert Hello.from_fields(header_fields(header_bytes(hello.fields())[4:])) == hello


def test_another_version_or_a_missing_field_is_a_link_error():
    with pytest.raises(LinkError, match="version"):
        Hello.from_fields({**HELLO.fields(), "relay": "1"})
    fields = HELLO.fields()
    del fields["source_node"]
    with pytest.raises(LinkError, match="source_node"):
        Hello.from_fields(fields)


def test_a_proof_holds_for_its_key_role_hello_and_challenge_only():
    good = proof(b"secret", "sink", HELLO.fields(), "c")
    assert is_proof(good, proof(b"secret", "sink", HELLO.fields(), "c"))
    assert not is_proof(good, proof(b"other", "sink", HELLO.fields(), "c"))
    assert not is_proof(good, proof(b"secret", "source", HELLO.fields(), "c"))
    assert not is_proof(good, proof(b"secret", "sink", HELLO.fields(), "d"))
    assert not is_proof(
        good, proof(b"secret", "sink", dataclasses.replace(HELLO, topic="/tf").fields(), "c")
    )
    assert not is_proof("\udcff", good)


def test_types_and_sums_agree_unless_both_are_said_and_differ():
    assert mismatch("a/B", "1", "a/B", "1") == ""
    assert mismatch(ANY, ANY, "a/B", "1") == ""
    assert "a/C" in mismatch("a/C", "1", "a/B", "1")
    assert "2" in mismatch("a/B", "2", "a/B", "1")


def test_an_unknown_state_counts_as_refused():
    assert state_from_field("type mismatch") is LinkState.TYPE_MISMATCH
    assert state_from_field("melted") is LinkState.REFUSED


@pytest.mark.parametrize(
    ("gateway", "name"),
    [
        ("aadi1_gateway", "/aadi1_gateway/pioneer1/amcl"),
        ("Hub Gateway", "/Hub_Gateway/pioneer1/amcl"),
        ("7-of-9.local", "/g7_of_9_local/pioneer1/amcl"),
        ("", "/g/pioneer1/amcl"),
    ],
)
def test_a_proxy_has_a_valid_name_that_says_where_it_comes_from(gateway, name):
    assert proxy_name(gateway, "/pioneer1/amcl") == name


def test_a_proxy_is_known_by_its_uri():
    assert is_proxy_uri(proxy_uri("host", 1234, "Hub Gateway"))
    assert not is_proxy_uri("http://host:1234/")
