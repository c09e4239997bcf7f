"""A gateway and a hub prove to each other that they know the password; a peer that does not know it learns nothing."""

import pytest

from rocon_hub_protocol.admission import REFUSED, GatewaySide, HubSide
from rocon_hub_protocol.cpace import ProofError

SECRET, OTHER = "open sesame", "open barley"


def test_who_knows_the_password_is_admitted_and_knows_that_the_hub_does() -> None:
    gateway = GatewaySide(SECRET)
    hub = HubSide(SECRET, gateway.first)
    proven, answer = hub.verdict(gateway.prove(hub.answer))
    assert proven
    assert gateway.accepts(answer)


def test_a_hub_refuses_a_gateway_with_another_password_and_proves_nothing_to_it() -> None:
    gateway = GatewaySide(OTHER)
    hub = HubSide(SECRET, gateway.first)
    assert hub.verdict(gateway.prove(hub.answer)) == (False, REFUSED)


def test_a_gateway_refuses_a_hub_that_does_not_know_the_password() -> None:
    gateway = GatewaySide(SECRET)
    rogue = HubSide(OTHER, gateway.first)
    gateway.prove(rogue.answer)
    assert not gateway.accepts(b"+" + b"00" * 64 + b"\r\n")


def test_nothing_that_was_said_serves_a_second_time() -> None:
    gateway = GatewaySide(SECRET)
    proof = gateway.prove(HubSide(SECRET, gateway.first).answer)
    assert HubSide(SECRET, gateway.first).verdict(proof) == (False, REFUSED)


@pytest.mark.parametrize(
    "line", [b"", b"PING\r\n", b"ROCON-PROVE 2 00\r\n", b"\xff" * 40, b"ROCON-PROVE 1 \r\n"]
)
def test_a_line_that_is_none_of_the_protocols_is_refused(line: bytes) -> None:
    with pytest.raises(ProofError):
        HubSide(SECRET, line)
    with pytest.raises(ProofError):
        HubSide(SECRET, GatewaySide(SECRET).first).verdict(line)
    with pytest.raises(ProofError):
        GatewaySide(SECRET).prove(line)
