"""The hub's port with a password."""

import contextlib
import socket
from pathlib import Path

from pioneer_harness.port import PortReservation
from rocon_hub.adapters.front import Front
from rocon_hub_protocol.core.admission import GatewaySide
from tcpros.adapters.descriptor import raise_limit

CROWD = 600
PATIENCE = 60.0


def line(connection: socket.socket) -> bytes:
    """Reads a line; empty where the hub has closed."""
    said = b""
    while not said.endswith(b"\n") and (more := connection.recv(512)):
        said += more
    return said


def test_gateways_that_come_all_at_once_are_admitted_at_their_first_attempt(tmp_path: Path) -> None:
    """Of more than 256 the hub once closed the oldest, which came back and pushed others out."""
    raise_limit()
    ports = PortReservation()
    port = ports.take(17380)
    with contextlib.ExitStack() as stack:
        stack.callback(ports.release)
        redis = stack.enter_context(socket.socket(socket.AF_UNIX))
        redis.bind(str(tmp_path / "redis"))
        redis.listen(CROWD)
        front = Front(port, str(tmp_path / "redis"), lambda: "open sesame", None)
        stack.callback(front.close)
        crowd = [
            (socket.create_connection(("127.0.0.1", port), PATIENCE), GatewaySide("open sesame")) for _ in range(CROWD)
        ]
        for connection, side in crowd:
            stack.enter_context(connection)
            connection.sendall(side.first)
        for connection, side in crowd:
            connection.sendall(side.prove(line(connection)))
        assert all(side.accepts(line(connection)) for connection, side in crowd)
