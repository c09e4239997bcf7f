"""TLS handshakes that do not end are limited in time and number, and those that end lose no data."""

import asyncio
import socket
import ssl
import subprocess

import pytest

from pioneer_web.access.admission import Admission
from pioneer_web.access.listener import Listener

PATIENCE = 0.5
MOST = 4
GUARD = 20.0


class Echo(asyncio.Protocol):
    def connection_made(self, transport):
        self.transport = transport

    def data_received(self, data):
        self.transport.write(data)


@pytest.fixture(scope="module")
def contexts(tmp_path_factory):
    """The contexts of a server and its clients."""
    folder = tmp_path_factory.mktemp("tls")
    command = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:P-256",
        "-nodes",
    ]
    command += ["-keyout", folder / "key", "-out", folder / "crt", "-days", "1", "-subj", "/CN=x"]
    command += ["-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(command, check=True, capture_output=True)
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(folder / "crt", folder / "key")
    return server, ssl.create_default_context(cafile=folder / "crt")


def served(contexts, act, patience=PATIENCE, most=MOST):
    """Runs ``act`` with the address of an echo server."""

    async def run():
        faults = []
        admission = Admission(most, most)
        listener = Listener(Echo, "127.0.0.1", 0, contexts[0], faults.append, admission, patience)
        accepting = asyncio.create_task(listener.run())
        try:
            async with asyncio.timeout(GUARD):
                return await asyncio.to_thread(act, listener.addresses[0])
        finally:
            accepting.cancel()
            assert faults == []

    return asyncio.run(run())


def echoed(address, context, data):
    with (
        socket.create_connection(address, GUARD) as plain,
        context.wrap_socket(plain, server_hostname="127.0.0.1") as secured,
    ):
        secured.sendall(data)
        received = b""
        while len(received) < len(data):
            received += secured.recv(65536)
        return received


@pytest.mark.parametrize("size", [1, 1000])
def test_what_follows_the_handshake_at_once_is_not_lost(contexts, size):
    data = bytes(range(256)) * size
    assert (
        served(contexts, lambda address: echoed(address, contexts[1], data), patience=GUARD) == data
    )


@pytest.mark.parametrize("start", [b"", b"\x16\x03\x01", b"GET / HTTP/1.1\r\n\r\n"])
def test_a_handshake_that_does_not_end_is_closed_in_time(contexts, start):
    def act(address):
        with socket.create_connection(address, GUARD) as connection:
            connection.sendall(start)
            try:
                while connection.recv(4096):
                    pass
            except ConnectionError:
                pass
            return True

    assert served(contexts, act)


def test_handshakes_that_do_not_end_do_not_keep_others_out(contexts):
    """The oldest of too many is closed, long before its time is over."""

    def act(address):
        stuck = [socket.create_connection(address, GUARD) for _ in range(10 * MOST)]
        try:
            assert echoed(address, contexts[1], b"x") == b"x"
            closed = 0
            for connection in stuck[: -2 * MOST]:
                try:
                    closed += connection.recv(1) == b""
                except ConnectionError:
                    closed += 1
            return closed
        finally:
            for connection in stuck:
                connection.close()

    assert served(contexts, act, patience=GUARD) == 8 * MOST
