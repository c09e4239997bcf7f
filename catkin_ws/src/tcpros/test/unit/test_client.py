"""The blocking client, against a fake master, node and server."""

import socket
import struct
import threading
from contextlib import contextmanager
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from tcpros.client import Client, ClientError
from tcpros.header import header_bytes


class Text:
    """A message, request and response with a single text, like the classes that ROS generates."""

    _type, _md5sum = "std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"

    def __init__(self, data=""):
        self.data = data

    def serialize(self, buffer):
        buffer.write(self.data.encode())

    def deserialize(self, data):
        self.data = data.decode()
        return self


KIND = SimpleNamespace(_md5sum=Text._md5sum, _request_class=Text, _response_class=Text)


def frame(data):
    return struct.pack("<I", len(data)) + data


@contextmanager
def graph(*answers, **lookups):
    """A fake master that is also the only node; each connection to it gets one of `answers` and is closed."""
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    values = {
        "lookupNode": (1, "", None),
        "lookupService": (1, "", f"rosrpc://127.0.0.1:{port}"),
        "requestTopic": (1, "", ["TCPROS", "127.0.0.1", port]),
        **lookups,
    }

    def serve():
        for answer in answers:
            connection, _ = listener.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(answer)
                connection.recv(4096)

    with (
        listener,
        SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True) as master,
    ):
        uri = f"http://127.0.0.1:{master.server_address[1]}"
        values["lookupNode"] = (*values["lookupNode"][:2], uri)
        for name, value in values.items():
            master.register_function(lambda *_, value=value: value, name)
        threads = [
            threading.Thread(target=serve),
            threading.Thread(target=master.serve_forever, args=(0.01,)),
        ]
        for thread in threads:
            thread.start()
        yield Client(uri, "/tester")
        master.shutdown()
        for thread in threads:
            thread.join()


def test_a_latched_message_is_read():
    with graph(header_bytes({"type": Text._type}) + frame(b"hello")) as client:
        assert client.latched("/node", "/topic", Text).data == "hello"


def test_a_call_returns_the_response_and_a_failed_one_the_servers_words():
    header = header_bytes({"callerid": "/server"})
    with graph(header + b"\x01" + frame(b"yes"), header + b"\x00" + frame(b"it broke")) as client:
        assert client.call("/service", KIND, data="?").data == "yes"
        with pytest.raises(ClientError, match="it broke"):
            client.call("/service", KIND, data="?")


def test_a_refused_header_and_an_unknown_topic_are_errors_with_the_reason():
    with (
        graph(header_bytes({"error": "wrong type"})) as client,
        pytest.raises(ClientError, match="wrong type"),
    ):
        client.latched("/node", "/topic", Text)
    with (
        graph(requestTopic=(1, "", [])) as client,
        pytest.raises(ClientError, match="does not publish /topic"),
    ):
        client.latched("/node", "/topic", Text)
    with (
        graph(lookupService=(-1, "unknown service", 0)) as client,
        pytest.raises(ClientError, match="unknown service"),
    ):
        client.call("/service", KIND)


def test_a_connection_that_ends_within_a_message_is_a_network_error():
    with (
        graph(header_bytes({"type": "*"}) + b"\x09\x00\x00\x00abc") as client,
        client.subscribe("/n", "/t") as found,
    ):
        found._socket.shutdown(socket.SHUT_WR)
        with pytest.raises(ConnectionError):
            found.read_frame()


def test_a_finished_connection_still_gives_the_messages_that_have_arrived():
    words = [b"one", b"two", b"three"]
    arrived = header_bytes({"type": "*"}) + b"".join(map(frame, words))
    with graph(arrived) as client, client.subscribe("/n", "/t") as connection:
        connection.be_patient()
        connection.finish()
        assert [connection.read_frame() for _ in words] == words
        with pytest.raises(ConnectionError):
            connection.read_frame()
        connection.interrupt()
