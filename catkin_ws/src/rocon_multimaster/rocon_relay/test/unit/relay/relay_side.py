"""Two relays, each with its own master, and a subscriber that does not use ROS's code."""

import contextlib
import dataclasses
import hashlib
import itertools
import logging
import socket
import struct
import sys
import threading
import time
import xmlrpc.client
from pathlib import Path

from pioneer_harness.wait import wait_until
from rocon_relay.connection import ANY, Address, Export, Import, LinkState, RelayConfig
from rocon_relay.keyring import PasswordKeyring
from rocon_relay.link import Hello
from rocon_relay.option import NO_OPTIONS
from rocon_relay.relay import TcpRelay
from tcpros.header import header_bytes, header_fields

NODES = Path(__file__).parent.parent.parent / "node"
STRING = "std_msgs/String"
STRING_MD5 = "992ce8a1687cec8c8bd883ec73ca41d1"


class Side:
    """A master with its relay."""

    def __init__(self, name, master, certificates=None, password=None, salt="salt", **settings):
        self.name = name
        self.master = master
        self.changes = threading.Event()
        if password is not None:
            settings["keyring"] = self.keyring = PasswordKeyring(lambda: self.password)
            self.password = password
            self.keyring.learn(salt)
        config = RelayConfig(name, f"/gateway_{name}", master.uri, "127.0.0.1", **settings)
        self.relay = TcpRelay(
            config, self.changes.set, logging.getLogger(f"relay.{name}"), certificates
        )

    @property
    def address(self):
        return Address("127.0.0.1", self.relay.port)

    def state(self):
        """Returns the states of all imports and exports."""
        status = self.relay.status()
        return [link.state for link in (*status.imports.values(), *status.exports.values())]

    def link(self):
        """Returns the status of the only import or export."""
        status = self.relay.status()
        (link,) = (*status.imports.values(), *status.exports.values())
        return link

    def publishers(self, topic):
        return self.master.system_state()[0].get(topic, [])


class Subscriber:
    """A TCPROS subscriber of one publisher, implemented here so that no ROS code hides a fault."""

    def __init__(
        self, side, node, topic, name="/tester", type_=ANY, md5sum=ANY, receive_buffer=None
    ):
        self.uri = side.master.proxy().lookupNode(node)
        self.socket = None
        with node_at(self.uri) as slave:
            status, self.text, answer = slave.requestTopic(name, topic, [["TCPROS"]])
        self.header = None
        if status != 1:
            return
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(5)
        self.socket.connect((answer[1], answer[2]))
        fields = {
            "callerid": name,
            "topic": topic,
            "type": type_,
            "md5sum": md5sum,
            "tcp_nodelay": "1",
        }
        self.socket.sendall(header_bytes(fields))
        self.header = header_fields(self.bytes())

    def bytes(self):
        """Reads a length and returns the data that follows; b"" at the end."""
        length = self._exactly(4)
        return self._exactly(struct.unpack("<I", length)[0]) if length else b""

    def text_of_message(self):
        """Returns the text of the next std_msgs/String."""
        return self.bytes()[4:].decode()

    def is_ended(self, within):
        """Returns whether the connection ends in time, whatever arrives before."""
        self.socket.settimeout(within)
        deadline = time.monotonic() + within
        try:
            while time.monotonic() < deadline:
                if not self.socket.recv(65536):
                    return True
        except ConnectionError:
            return True
        except TimeoutError:
            return False
        return False

    def close(self):
        if self.socket is not None:
            self.socket.close()

    def _exactly(self, size):
        data = b""
        while len(data) < size:
            more = self.socket.recv(size - len(data))
            if not more:
                return b""
            data += more
        return data

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class Outsider:
    """A program that speaks the link protocol but does not know the password."""

    def __init__(self, source, beside=None, **changes):
        self.socket = socket.create_connection(source.address, 5)
        hello = Hello(
            "/chatter",
            ANY,
            ANY,
            "/talker1",
            "source",
            "sink",
            ("sink",),
            "00",
            keys=source_keys(source),
        )
        self.hello = dataclasses.replace(hello, **changes)
        self.sent = {**self.hello.fields(), **(beside or {})}
        self.socket.sendall(header_bytes(self.sent))

    def answer(self):
        """Returns the next header; None at the end."""
        with self.socket.makefile("rb") as file:
            length = file.read(4)
            return header_fields(file.read(*struct.unpack("<I", length))) if length else None


def source_keys(source):
    return source.keyring.names() if hasattr(source, "keyring") else ()


@contextlib.contextmanager
def node_at(uri):
    with xmlrpc.client.ServerProxy(uri) as slave:
        yield slave


def export(topic="/chatter", node="/talker1", type_=STRING, options=NO_OPTIONS):
    return Export(topic, type_, node, "sink", options)


def imported(
    source, topic="/chatter", node="/talker1", type_=STRING, md5sum=ANY, allowed=(), options=None
):
    return Import(
        topic, type_, md5sum, "source", node, source.address, allowed, options or NO_OPTIONS
    )


def connect(
    source,
    sink,
    topics=("/chatter",),
    nodes=("/talker1",),
    state=LinkState.ACTIVE,
    at_source=None,
    **more,
):
    pairs = list(itertools.product(topics, nodes))
    source.relay.apply({export(*pair, **(at_source or {})) for pair in pairs}, set())
    sink.relay.apply(set(), {imported(source, *pair, **more) for pair in pairs})
    wait_for(sink, state)


def wait_for(side, state, timeout=5):
    wait_until(
        lambda: side.state() and all(s is state for s in side.state()),
        f"{side.name} {state}",
        timeout,
    )


def number_of_good(subscriber):
    """Returns the number of the next message; asserts that its text is intact."""
    text = subscriber.text_of_message()
    whole = hashlib.sha256(str(int(text[:8])).encode()).hexdigest() * (len(text) // 64 + 1)
    assert whole.startswith(text[8:])
    return int(text[:8])


def subscribers_of_talker(master, topic="/chatter", node="/talker1"):
    with node_at(master.proxy().lookupNode(node)) as slave:
        return [row[1] for row in slave.getBusInfo("/tester")[2] if row[4] == topic]


def listener(group, side, topic, log, argv=None):
    group.start(
        "listener",
        argv or [sys.executable, str(NODES / "listener.py"), topic],
        side.master.environment,
        log,
    )


def lines(path):
    return path.read_text().splitlines() if path.exists() else []
