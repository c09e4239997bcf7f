"""XML-RPC calls to a node that a real ROS node would not make."""

import xmlrpc.client
from types import SimpleNamespace
from typing import Any

import pytest

from tcpros.slave_api import SlaveApi

TOPIC: Any = SimpleNamespace(refusal=lambda _caller: "")


@pytest.mark.parametrize("protocols", [[{"a": 1}], [["UDPROS"]], [5], 5, "TCPROS", [[]], [{}]])
def test_protocols_that_are_none_get_an_answer(protocols: Any) -> None:
    """A dictionary among the protocols once caused an internal error with a traceback in the log."""
    api = SlaveApi("/talker", "http://here:1/", "http://here:2/", ("here", 1), {"/chatter": TOPIC})
    request = xmlrpc.client.dumps(("/caller", "/chatter", protocols), "requestTopic")
    [(code, reason, _)], _ = xmlrpc.client.loads(api.answer(request.encode()))
    assert code in (-1, 0)
    assert reason
