"""XML-RPC calls to a node that a real ROS node would not make."""

import time
import xmlrpc.client
from types import SimpleNamespace
from typing import Any

import pytest

from tcpros.slave_api import SlaveApi, SlaveApiError

TOPIC: Any = SimpleNamespace(refusal=lambda _caller: "")


@pytest.mark.parametrize("protocols", [[{"a": 1}], [["UDPROS"]], [5], 5, "TCPROS", [[]], [{}]])
def test_protocols_that_are_none_get_an_answer(protocols: Any) -> None:
    """A dictionary among the protocols once caused an internal error with a traceback in the log."""
    api = SlaveApi("/talker", "http://here:1/", "http://here:2/", ("here", 1), {"/chatter": TOPIC})
    request = xmlrpc.client.dumps(("/caller", "/chatter", protocols), "requestTopic")
    [(code, reason, _)], _ = xmlrpc.client.loads(api.answer(request.encode()))
    assert code in (-1, 0)
    assert reason


BOMB = """<?xml version="1.0"{encoding}?><!DOCTYPE l [<!ENTITY a "ha">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">
<!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;"><!ENTITY e "&d;&d;&d;&d;&d;&d;&d;&d;">
<!ENTITY f "&e;&e;&e;&e;&e;&e;&e;&e;">]><methodCall><methodName>getPid</methodName>
<params><param><value>&f;</value></param></params></methodCall>"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_a_document_type_is_refused_before_its_entities_expand(encoding: str) -> None:
    """562 bytes of nested entities once cost 0.18 s of CPU time."""
    api = SlaveApi("/talker", "http://here:1/", "http://here:2/", ("here", 1), {})
    declared = "" if encoding.startswith("utf") else f' encoding="{encoding}"'
    began = time.process_time()
    with pytest.raises(SlaveApiError):
        api.answer(BOMB.format(encoding=declared).encode(encoding))
    assert time.process_time() - began < 0.05
