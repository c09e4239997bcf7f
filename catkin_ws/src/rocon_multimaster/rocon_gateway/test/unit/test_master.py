"""Possible answers of a ROS master, and how they are handled."""

import threading
import xmlrpc.client
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from rocon_gateway.master.line import MasterError
from rocon_gateway.master.watch import MasterWatch
from rocon_hub_protocol.rule import Connection, Kind


def answer(value: object, code: int = 1) -> bytes:
    return xmlrpc.client.dumps(((code, "", value),), methodresponse=True).encode()


STATE = answer([[["/chatter", ["/talker"]]], [], [["/gateway/flip", ["/gateway"]]]])
TYPES = answer([["/chatter", "std_msgs/String"]])
URI = answer("http://127.0.0.1:1/")
SOUND = {"getSystemState": STATE, "getTopicTypes": TYPES, "lookupNode": URI}
CHATTER = {Connection(Kind.PUBLISHER, "/chatter", "std_msgs/String", "/talker")}


class FakeMaster(ThreadingHTTPServer):
    """Answers each method with the configured value, whatever that is."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.answers, self.status = dict(SOUND), 200


class _Handler(BaseHTTPRequestHandler):
    server: FakeMaster
    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        _, method = xmlrpc.client.loads(body)
        said = self.server.answers[str(method)]
        self.send_response(self.server.status)
        self.send_header("Content-Length", str(len(said)))
        self.end_headers()
        self.wfile.write(said)

    def log_message(self, format: str, *args: object) -> None:
        """Suppresses logging."""


@pytest.fixture
def master() -> Iterator[FakeMaster]:
    made = FakeMaster()
    thread = threading.Thread(target=made.serve_forever, args=(0.01,))
    thread.start()
    yield made
    made.shutdown()
    thread.join()
    made.server_close()


@pytest.fixture
def watch(master: FakeMaster) -> Iterator[MasterWatch]:
    made = MasterWatch(f"http://127.0.0.1:{master.server_port}/", "/gateway")
    yield made
    made.close()


NONSENSE = {
    "nothing": b"",
    "no XML": b"no such page",
    "a page": b"<html><body>503</body></html>",
    "a fault": xmlrpc.client.dumps(xmlrpc.client.Fault(1, "KeyError")).encode(),
    "a refusal": answer(0, -1),
    "two parts": xmlrpc.client.dumps(((1, "ok"),), methodresponse=True).encode(),
    "a number": answer(7),
    "rows of numbers": answer([[[1, [2]]], [[1, 2]], []]),
    "texts for lists": answer(["abc", "def", "ghi"]),
    "half a struct": b"<params><param><value><struct><value>1</value></struct></value></param></params>",
    "a bad decimal": b"<params><param><value><bigdecimal>x</bigdecimal></value></param></params>",
}


@pytest.mark.parametrize("method", ["getSystemState", "getTopicTypes"])
@pytest.mark.parametrize("nonsense", NONSENSE.values(), ids=NONSENSE)
def test_a_master_that_answers_nonsense_counts_as_lost_until_it_answers_again(
    master: FakeMaster, watch: MasterWatch, method: str, nonsense: bytes
) -> None:
    """Most invalid answers once ended the gateway."""
    assert watch.changed()
    master.answers |= {"getSystemState": STATE.replace(b"/talker", b"/other"), method: nonsense}
    for _ in range(2):
        with pytest.raises(MasterError):
            watch.changed()
    assert (watch.local, watch.knows_us) == (CHATTER, True)
    master.answers |= SOUND
    assert watch.changed()
    assert not watch.changed()
    assert watch.local == CHATTER


@pytest.mark.parametrize("said", [b"", STATE], ids=["empty", "sound"])
def test_an_error_of_http_counts_as_no_answer(
    master: FakeMaster, watch: MasterWatch, said: bytes
) -> None:
    master.status, master.answers["getSystemState"] = 500, said
    with pytest.raises(MasterError, match="500 Internal Server Error"):
        watch.changed()


def test_a_node_that_the_master_does_not_know_any_more_is_left_out(
    master: FakeMaster, watch: MasterWatch
) -> None:
    master.answers["lookupNode"] = answer("", -1)
    assert watch.changed()
    assert watch.local == frozenset()


def test_a_master_that_fails_to_look_a_node_up_counts_as_lost(
    master: FakeMaster, watch: MasterWatch
) -> None:
    master.answers["lookupNode"] = NONSENSE["a fault"]
    with pytest.raises(MasterError, match="KeyError"):
        watch.changed()


def test_of_our_own_topics_only_those_that_are_to_cross_count(master: FakeMaster) -> None:
    rows = [
        ["/chatter", ["/talker"]],
        ["/pioneer1/computer", ["/gateway"]],
        ["/gateway/rules", ["/gateway"]],
    ]
    master.answers["getSystemState"] = answer([rows, [], []])
    watch = MasterWatch(
        f"http://127.0.0.1:{master.server_port}/", "/gateway", {"/pioneer1/computer"}
    )
    assert watch.changed()
    assert {one.name for one in watch.local} == {"/chatter", "/pioneer1/computer"}
    watch.close()
