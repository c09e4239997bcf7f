"""Requests and messages of a gateway that are longer than the buffer of its event loop."""

import time

import pytest
from gateway_msgs import msg, srv

from tcpros.reactor import BUFFER_SIZE

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

LONG = "[a-z0-9_/]*/" + "a" * 190
"""The rest of a name in a rule, long enough that 500 rules exceed the buffer."""


def test_the_rules_of_500_robots_are_flipped_in_one_request(standing, report) -> None:
    """The connection was reset, and the latched list of rules never arrived."""
    base, _ = standing
    remotes = [
        msg.RemoteRule(
            "robot",
            msg.Rule("publisher", f"/pioneer{number}/{LONG}", f"/pioneer{number}/{LONG}{LONG}"),
        )
        for number in range(500)
    ]
    size = sum(len(one.rule.name) + len(one.rule.node) + 31 for one in remotes)
    began = time.monotonic()
    assert base.call("flip", srv.Remote, remotes=remotes, cancel=False).result == 0
    report(f"a request of about {size} bytes", time.monotonic() - began)
    assert len(base.info().flip_watchlist) == len(remotes)
    assert base.call("flip", srv.Remote, remotes=remotes, cancel=True).result == 0
    assert base.info().flip_watchlist == []
    assert size > BUFFER_SIZE
