"""A ROS master that answers with errors or late for a while: running links continue, and links that end are closed."""

import contextlib
import http.client
import os
import signal
import threading
import time
import xmlrpc.client
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from gateway_msgs import msg, srv
from measure import longest_gap

from pioneer_harness.masters import Master
from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


class MadMaster(Master):
    """A master behind a web server that forwards each request, delays it, or answers it with an error."""

    def __init__(self) -> None:
        super().__init__()
        self.front = ThreadingHTTPServer(("127.0.0.1", 0), _Handler)
        self.front.daemon_threads = True
        self.front.may_answer = threading.Event()
        self.front.may_answer.set()
        self.front.behind, self.front.is_mad, self.front.before, self.front.after = (
            self.port,
            False,
            {},
            {},
        )
        threading.Thread(target=self.front.serve_forever, args=(0.05,), daemon=True).start()

    @property
    def environment(self) -> dict[str, str]:
        return {
            **super().environment,
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.front.server_port}/",
        }

    def stop(self) -> None:
        self.front.shutdown()
        self.front.server_close()
        super().stop()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Any

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        method = str(xmlrpc.client.loads(body)[1])
        self.server.may_answer.wait()
        self.server.before.get(method, str)()
        status, said = (500, b"") if self.server.is_mad else _asked(self.server.behind, body)
        self.server.after.get(method, str)()
        self.send_response(status)
        self.send_header("Content-Type", "text/xml")
        self.send_header("Content-Length", str(len(said)))
        # A client that no longer waits for the answer of a master that hung has closed the connection.
        with contextlib.suppress(ConnectionError):
            self.end_headers()
            self.wfile.write(said)

    def log_message(self, format: str, *args: object) -> None:
        """Suppresses logging."""


def _asked(port: int, body: bytes) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    try:
        connection.request("POST", "/RPC2", body, {"Content-Type": "text/xml"})
        response = connection.getresponse()
        return response.status, response.read()
    finally:
        connection.close()


@pytest.fixture
def mad(standing_fleet) -> Iterator[MadMaster]:
    made = MadMaster()
    yield made
    made.front.is_mad = False
    made.front.may_answer.set()


def test_a_master_that_answers_nonsense_stops_no_data_and_is_one_line(
    standing_fleet, standing, mad
) -> None:
    _, robot = standing
    site = standing_fleet.site("bedlam", mad)
    site.start().connected()
    robot.talk("/flow")
    ear = site.hear("/flow")
    assert site.flip("robot", "subscriber", "/flow") == 0
    ear.first_after(0.0)
    began, mad.front.is_mad = time.monotonic(), True
    lost, back = "running links stay up", "the ROS master answers again"
    wait_until(lambda: lost in site.log.read_text(), "the line", 5)
    wait_until(lambda: time.monotonic() - began > 1.0, "several looks at the master", 3)
    mad.front.is_mad = False
    wait_until(lambda: back in site.log.read_text(), "the master is sane", 5)
    assert site.flip("robot", "subscriber", "/other") == 0
    wait_until(lambda: site.states()["flip /flow"] == "active", "active", 5)
    assert longest_gap(ear.times(), began) < 1.0
    said = site.log.read_text()
    assert (said.count(lost), said.count(back), said.count("registered again")) == (1, 1, 0)


def test_a_change_by_service_shows_once_it_has_answered_on_a_slow_master(
    standing_fleet, mad
) -> None:
    """A script that flipped and then read the rules once received the old ones."""
    site = standing_fleet.site("hospital", mad).start().connected()
    slow = threading.Event()
    mad.front.before["getSystemState"] = lambda: slow.wait(0.2)
    for number in range(1, 4):
        assert site.flip("robot", "subscriber", f"/late{number}") == 0
        assert len(site.info().flip_watchlist) == number
        assert f"flip /late{number}" in site.states()
    assert site.flip("robot", "subscriber", "/late1", cancel=True) == 0
    assert "flip /late1" not in site.states()
    slow.set()


def test_a_gateway_unregistered_during_shutdown_does_not_re_register(
    standing_fleet, standing, mad
) -> None:
    """A gateway that polled the master during shutdown once took it for a restarted one and left a dead node there."""
    site = standing_fleet.site("asylum", mad).start().connected()
    asked, looked, registered = threading.Event(), threading.Event(), threading.Event()

    def is_served() -> bool:
        return any("/gateway" in nodes for nodes in mad.system_state()[2].values())

    def answer_late() -> None:
        asked.set()
        wait_until(lambda: not is_served(), "all services unregistered", 10)

    mad.front.before["registerPublisher"] = registered.set
    mad.front.after["getSystemState"] = looked.set
    mad.front.before["getSystemState"] = answer_late
    # Interrupt it during a poll: between two polls, a gateway shuts down without another one.
    assert asked.wait(10)
    looked.clear()
    os.kill(site.pid, signal.SIGINT)
    wait_until(lambda: not standing_fleet.group.is_running(site.name), "the gateway's end", 15)
    assert looked.is_set()
    assert not registered.is_set()
    assert "registered again" not in site.log.read_text()
    assert site.publishers("/gateway/gateway_info") == []


def test_a_master_that_only_hung_keeps_what_was_changed_on_it_since_a_parameter_was_pulled(
    standing_fleet, standing, mad
) -> None:
    """It was taken for a restarted master, and the pulled values replaced the local changes."""
    base, _ = standing
    site = standing_fleet.site("coma", mad)
    site.start().connected()
    base.master.set_param("/gain", 1)
    rule = msg.Rule("parameter", "/gain", "")
    assert base.call("advertise", srv.Advertise, rules=[rule]).result == 0
    assert site.pull("base", "parameter", "/gain") == 0
    wait_until(lambda: site.states()["pull /gain"].startswith("active"), "copied", 5)
    assert mad.get_param("/gain") == 1
    mad.set_param("/gain", 2)
    lost, back = "running links stay up", "the ROS master answers again"
    for times in (1, 2):
        mad.front.may_answer.clear()
        wait_until(lambda n=times: site.log.read_text().count(lost) == n, "the line", 15)
        mad.front.may_answer.set()
        wait_until(lambda n=times: site.log.read_text().count(back) == n, "it is awake", 15)
        # A rule that is reconciled afterwards shows that the gateway has done what it does then.
        assert site.flip("robot", "subscriber", f"/after{times}") == 0
        assert site.states()[f"flip /after{times}"]
        assert mad.get_param("/gain") == 2
    assert "registered again" not in site.log.read_text()
    assert site.pull("base", "parameter", "/gain", cancel=True) == 0
    assert base.call("advertise", srv.Advertise, rules=[rule], cancel=True).result == 0
