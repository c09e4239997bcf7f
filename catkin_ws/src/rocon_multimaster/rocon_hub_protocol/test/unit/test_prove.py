"""A gateway's side of the proof, against arbitrary servers where it expects a hub."""

import socket
import threading
import time

import pytest

from rocon_hub_protocol import redis_client

STEP = 0.05


def test_a_hub_that_sends_a_byte_at_a_time_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each byte once restarted the timeout, so that such a hub blocked a gateway's thread for 40 minutes."""
    monkeypatch.setattr(redis_client, "PROOF_TIMEOUT", 10 * STEP)
    ours, theirs = socket.socketpair()
    over = threading.Event()

    def drip() -> None:
        while not over.wait(STEP):
            theirs.send(b"+")

    with ours, theirs:
        dripping = threading.Thread(target=drip)
        dripping.start()
        began = time.monotonic()
        try:
            with pytest.raises(TimeoutError):
                redis_client.prove(ours, "open sesame")
        finally:
            over.set()
            dripping.join()
        assert time.monotonic() - began < redis_client.LONGEST_LINE * STEP / 2
