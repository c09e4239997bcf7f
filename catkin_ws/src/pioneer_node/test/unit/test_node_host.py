"""Nodes without rospy: several run in one process, and each is an ordinary node to all others."""

import logging
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import pytest
from rosgraph_msgs.msg import Clock, Log
from std_msgs.msg import String
from std_srvs.srv import SetBool

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.wait import START, wait_until
from pioneer_node.adapters.node_handle import NodeHandle
from tcpros import node_context
from tcpros.client import Client, ClientError
from tcpros.node import Node
from tcpros.node_context import NodeContext
from tcpros.reactor import Reactor

COMMAND = (
    sys.executable,
    "-c",
    "from pioneer_node.nodes.node_host import main; raise SystemExit(main())",
)
HOSTED = Path(__file__).parent


@pytest.fixture
def master() -> Iterator[Master]:
    with Master() as made:
        yield made


class Host:
    """A process that hosts nodes."""

    def __init__(self, master: Master, output: IO[str], words: tuple[str, ...]) -> None:
        environment = master.environment
        environment["PYTHONPATH"] = f"{HOSTED}:{environment.get('PYTHONPATH', '')}"
        environment["ROS_NAMESPACE"] = "robot"
        self.output = output
        self.process = subprocess.Popen(
            [*COMMAND, *words], env=environment, stdout=self.output, stderr=self.output
        )
        self.client = Client(master.uri, "/tester")

    def await_node(self, name: str) -> None:
        wait_until(
            lambda: self.answers(f"{name}/switch", "lookupService"), f"{name}'s service", START
        )

    def answers(self, name: str, method: str = "lookupNode") -> bool:
        try:
            return bool(self.client.ask_master(method, name))
        except ClientError:
            return False

    def text(self) -> str:
        self.output.seek(0)
        return self.output.read()


@pytest.fixture
def host(master: Master, tmp_path: Path) -> Iterator[Callable[..., Host]]:
    """Yields a function that starts a process with nodes; kills these processes at the end."""
    started: list[Host] = []

    def start(*words: str, output: IO[str] | None = None) -> Host:
        started.append(Host(master, output or (tmp_path / "output").open("w+"), words))
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.wait()
        one.output.close()


class Peer:
    """A node of the test, with its own event loop."""

    def __init__(self, uri: str) -> None:
        self.reactor = Reactor(logging.getLogger("peer"))
        context = NodeContext(
            self.reactor, uri, "127.0.0.1", "127.0.0.1", logging.getLogger("peer")
        )
        self.node = Node(context, "/peer", lambda _reason: None)
        self.heard: list[Any] = []
        self.reactor.start()

    def call(self, function: Callable[[], Any]) -> Any:
        found: list[Any] = []
        self.reactor.call(lambda: found.append(function()))
        wait_until(lambda: bool(found), "the loop", START)
        return found[0]

    def hear(self, topic: str, kind: Any) -> None:
        self.call(
            lambda: self.node.subscribe(
                topic,
                kind,
                lambda data, sender: self.heard.append(
                    (sender.name, kind().deserialize(bytes(data)))
                ),
            )
        )

    def publisher(self, topic: str, kind: Any) -> Callable[[bytes], None]:
        publication = self.call(lambda: self.node.publish(topic, kind))
        return lambda body: self.reactor.call(
            lambda: publication.send(struct.pack("<I", len(body)) + body)
        )

    def texts(self, sender: str) -> list[str]:
        return [
            message.data
            for name, message in self.heard
            if name == sender and isinstance(message, String)
        ]


@pytest.fixture
def peer(master: Master) -> Iterator[Peer]:
    made = Peer(master.uri)
    yield made
    made.reactor.call(made.reactor.stop)
    made.reactor.join(START)


def test_a_node_made_long_before_its_loop_runs_is_registered(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(node_context, "PATIENCE", 0.1)
    logger, ended = logging.getLogger("early"), list[str]()
    reactor = Reactor(logger)
    node = Node(
        NodeContext(reactor, master.uri, "127.0.0.1", "127.0.0.1", logger), "/early", ended.append
    )
    node.publish("/early/said", String)
    overdue = time.monotonic() + 0.2
    wait_until(lambda: time.monotonic() > overdue, "the end of what a call may take", START)
    reactor.start()
    wait_until(lambda: "/early/said" in master.system_state()[0], "the registration", START)
    reactor.call(reactor.stop)
    reactor.join(START)
    assert not ended


def word(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def test_two_nodes_of_one_process_are_nodes_for_all_others(
    host: Callable[..., Host], master: Master
) -> None:
    master.set_param("/robot/one/gain", 2)
    both = host("one=hosted", "two=hosted")
    for name in ("one", "two"):
        both.await_node(f"/robot/{name}")
        uri = both.client.ask_master("lookupNode", f"/robot/{name}")
        with xmlrpc.client.ServerProxy(uri) as node:
            assert node.getName("/tester")[2] == f"/robot/{name}"
            published = dict(node.getPublications("/tester")[2])
            assert node.getPid("/tester")[2] == both.process.pid
        assert published == {
            "/rosout": "rosgraph_msgs/Log",
            f"/robot/{name}/said": "std_msgs/String",
        }
    _, _, services = master.system_state()
    assert {
        f"/robot/one/{name}" for name in ("get_loggers", "set_logger_level", "switch")
    } <= services.keys()
    assert "made with gain 2" in both.text()
    assert "made with gain 1" in both.text()
    both.process.send_signal(signal.SIGINT)
    assert both.process.wait(START) == 0
    assert not any(both.answers(f"/robot/{name}") for name in ("one", "two"))
    assert not [topic for topic, nodes in master.system_state()[0].items() if "/robot/one" in nodes]


def test_messages_services_parameters_and_time_reach_a_node(
    host: Callable[..., Host], master: Master, peer: Peer
) -> None:
    master.set_param("/use_sim_time", True)
    one = host("one=hosted", "words:=/elsewhere", "_gain:=3")
    one.await_node("/robot/one")
    peer.hear("/robot/one/said", String)
    say, tell = peer.publisher("/elsewhere", String), peer.publisher("/clock", Clock)

    def said(text: str, *words: str) -> bool:
        say(word(text))
        return any(all(one in found for one in words) for found in peer.texts("/robot/one"))

    wait_until(lambda: said("hello", "hello x3 of /peer at 0.00, None"), "an echo", START)

    def told(text: str) -> bool:
        # The node may connect to /clock later than to the other topic.
        tell(struct.pack("<II", 12, 500_000_000))
        return said("later", text)

    wait_until(lambda: told("later x3 of /peer at 12.50"), "the time", START)
    master.set_param("/robot/shared", "news")
    wait_until(lambda: said("then", "then x3", "news"), "the parameter's change", START)
    wait_until(lambda: said("tick", "ticked"), "a tick", START)

    answer = one.client.call("/robot/one/switch", SetBool, data=True)
    assert (answer.success, answer.message) == (True, "/elsewhere")
    with pytest.raises(ClientError, match="it stays on"):
        one.client.call("/robot/one/switch", SetBool, data=False)
    assert one.client.call("/robot/one/switch", SetBool, data=True).success

    with xmlrpc.client.ServerProxy(one.client.ask_master("lookupNode", "/robot/one")) as node:
        _, heard, _ = node.getBusStats("/tester")[2]
    assert all(count > 0 for name, rows in heard if name == "/elsewhere" for _, count, *_ in rows)


def test_a_service_that_waits_keeps_nobody_else_waiting_and_answers_in_order(
    host: Callable[..., Host],
) -> None:
    one = host("one=hosted")
    one.await_node("/robot/one")
    wait_until(lambda: one.answers("/robot/one/gate", "lookupService"), "the gate", START)
    answers: list[str] = []

    def ask() -> None:
        with one.client.service("/robot/one/gate", SetBool._md5sum, persistent="1") as connection:
            answers.extend(
                connection.call(SetBool, data=data).message for data in (True, False, True)
            )

    waiting = threading.Thread(target=ask)
    waiting.start()
    assert one.client.call("/robot/one/switch", SetBool, data=True).success
    assert one.client.call("/robot/one/gate", SetBool, data=False).message == "passed"
    waiting.join(START)
    assert answers == ["passed"] * 3


def test_a_malformed_message_and_a_failing_callback_cost_themselves_only(
    host: Callable[..., Host], peer: Peer
) -> None:
    one = host("one=hosted")
    one.await_node("/robot/one")
    peer.hear("/robot/one/said", String)
    peer.hear("/rosout", Log)
    say = peer.publisher("/robot/words", String)

    def echoed() -> bool:
        before = len(peer.texts("/robot/one"))
        say(word("hello"))
        return before > 0

    wait_until(echoed, "an echo", START)
    for _ in range(3):
        say(b"\xff\xff\xff")
    say(word("fail"))
    wait_until(lambda: "RuntimeError: as asked" in one.text(), "the fault", START)
    assert one.text().count("dropped an invalid message on /robot/words from /peer") == 1
    wait_until(
        lambda: any("bad callback" in one.msg for _, one in peer.heard if isinstance(one, Log)),
        "/rosout",
        START,
    )
    assert {one.name for _, one in peer.heard if isinstance(one, Log)} == {"/robot/one"}
    before = len(peer.texts("/robot/one"))
    wait_until(
        lambda: echoed() and len(peer.texts("/robot/one")) > before, "an echo after it", START
    )


def full_disk() -> IO[str]:
    return Path("/dev/full").open("w")


def pipe_without_reader() -> IO[str]:
    reader, writer = os.pipe()
    os.close(reader)
    return os.fdopen(writer, "w")


@pytest.mark.parametrize("output", [full_disk, pipe_without_reader])
def test_lines_that_cannot_be_written_end_no_process(
    host: Callable[..., Host], peer: Peer, output: Callable[[], IO[str]]
) -> None:
    one = host("one=hosted", output=output())
    one.await_node("/robot/one")
    peer.hear("/robot/one/said", String)
    say = peer.publisher("/robot/words", String)

    def echoed() -> bool:
        say(word("fail"))
        say(word("after"))
        return any(text.startswith("after ") for text in peer.texts("/robot/one"))

    wait_until(echoed, "an echo after a failure", START)
    assert one.process.poll() is None


def test_a_node_that_is_asked_to_end_leaves_the_others_and_the_last_ends_the_process(
    host: Callable[..., Host],
) -> None:
    both = host("one=hosted", "two=hosted")
    for name in ("/robot/one", "/robot/two"):
        both.await_node(name)

    def end(name: str) -> None:
        with xmlrpc.client.ServerProxy(both.client.ask_master("lookupNode", name)) as node:
            assert node.shutdown("/tester", "enough")[0] == 1

    end("/robot/one")
    wait_until(
        lambda: not both.answers("/robot/one/switch", "lookupService"), "the end of one", START
    )
    assert both.client.call("/robot/two/switch", SetBool, data=True).success
    end("/robot/two")
    assert both.process.wait(START) == 0


def test_a_bad_parameter_ends_the_process_with_one_line(
    host: Callable[..., Host], master: Master
) -> None:
    master.set_param("/robot/two/gain", "much")
    both = host("one=hosted", "two=hosted")
    assert both.process.wait(START) == 1
    (line,) = [line for line in both.text().splitlines() if "FATAL" in line]
    assert line.endswith("/robot/two: ~gain is 'much', not a number")
    assert "Traceback" not in both.text()
    assert not any(both.answers(name) for name in ("/robot/one", "/robot/two"))


def test_lines_have_rospys_form(host: Callable[..., Host], tmp_path: Path) -> None:
    log = tmp_path / "log"
    one = host("one=hosted", f"__log:={log}")
    one.await_node("/robot/one")
    (line,) = one.text().splitlines()
    assert re.fullmatch(r"\[WARN\] \[\d+\.\d{6}\]: made with gain 1", line)
    assert log.read_text().startswith("[rosout][WARNING] ")


@pytest.mark.parametrize("words", [(), ("hosted",), ("=hosted",), ("one=",)])
def test_a_wrong_command_line_is_a_usage_error(words: tuple[str, ...]) -> None:
    done = subprocess.run(
        [*COMMAND, *words], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "usage: node_host NAME=MODULE" in done.stderr


@pytest.mark.parametrize("comes", [True, False], ids=["it comes", "the end is asked for"])
def test_a_node_waits_for_its_master(tmp_path: Path, comes: bool) -> None:
    ports = PortReservation()
    port = ports.take(15811)
    environment = {**os.environ, "PYTHONPATH": f"{HOSTED}:{os.environ.get('PYTHONPATH', '')}"}
    environment |= {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}/",
        "ROS_IP": "127.0.0.1",
        "ROS_HOME": str(tmp_path),
    }
    with (
        (tmp_path / "output").open("w+") as output,
        subprocess.Popen(
            [*COMMAND, "one=hosted"], env=environment, stdout=output, stderr=output
        ) as process,
    ):
        wait_until(
            lambda: "waiting for the ROS master" in (tmp_path / "output").read_text(),
            "the line",
            START,
        )
        ports.release()
        if comes:
            with Master(port) as late:
                wait_until(lambda: "/one/said" in late.system_state()[0], "the node", START)
                process.send_signal(signal.SIGINT)
                assert process.wait(START) == 0
        else:
            process.send_signal(signal.SIGTERM)
            assert process.wait(START) == 0
    assert (tmp_path / "output").read_text().count("waiting for the ROS master") == 1
    assert "Traceback" not in (tmp_path / "output").read_text()


def test_a_handle_resolves_names_as_rospy_does(master: Master, peer: Peer) -> None:
    del peer
    reactor = Reactor(logging.getLogger("handle"))
    context = NodeContext(
        reactor, master.uri, "127.0.0.1", "127.0.0.1", logging.getLogger("handle")
    )
    handle = NodeHandle(context, "/a/node", {"/a/old": "/b/new"}, lambda _reason: None)
    names = ("topic", "/topic", "~topic", "old", "/a/old")
    assert [handle.resolved(name) for name in names] == [
        "/a/topic",
        "/topic",
        "/a/node/topic",
        "/b/new",
        "/b/new",
    ]
    master.set_param("/a/tf_prefix", "robot")
    assert handle.found_parameter("tf_prefix", "") == "robot"
    assert handle.found_parameter("none_such", 7) == 7
    handle.close(reactor.stop)
    reactor.run()
