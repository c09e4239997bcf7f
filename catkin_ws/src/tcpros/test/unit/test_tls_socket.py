"""A non-blocking TLS socket: whatever the kernel accepts and delivers, the data arrives unchanged."""

import contextlib
import random
import socket

import pytest

from tcpros.tls import TlsError
from tcpros.tls_socket import PIECE, NoTlsError, Tls, begins_tls

SIZE = 3_000_000


@pytest.fixture
def pair():
    """Two connected sockets with small buffers."""
    ends = socket.socketpair()
    for end in ends:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 20_000)
    yield ends
    for end in ends:
        end.close()


@pytest.fixture
def ends(pair, identities):
    """The client's and the server's TLS sockets, before any handshake."""
    tls = Tls(identities())
    return tls.dialled(pair[0]), tls.accepted(pair[1])


def shake(*ends):
    done = [False] * len(ends)
    while not all(done):
        done = [done[i] or end.shake_hands() for i, end in enumerate(ends)]


def received(end, size=256 * 1024):
    buffer = memoryview(bytearray(size))
    with contextlib.suppress(BlockingIOError):
        return bytes(buffer[: end.recv_into(buffer)])
    return b""


def sent(end, data, by_message):
    with contextlib.suppress(BlockingIOError):
        return end.sendmsg([data, data[:0]]) if by_message else end.send(data)
    return 0


@pytest.mark.parametrize("by_message", [False, True])
def test_large_data_crosses_whole_through_a_kernel_that_takes_little_at_a_time(ends, by_message):
    client, server = ends
    shake(client, server)
    data = memoryview(random.Random(1).randbytes(SIZE))
    for sender, receiver in ((client, server), (server, client)):
        got, done, was_partial = [], 0, False
        while sum(map(len, got)) < SIZE:
            count = sent(sender, data[done:], by_message)
            was_partial |= 0 < count < len(data) - done
            done += count
            with contextlib.suppress(BlockingIOError):
                sender.flush()
            got.append(received(receiver))
        assert b"".join(got) == data
        assert was_partial
        assert done == SIZE


def test_small_buffers_go_together_and_no_more_than_a_piece_waits(ends):
    client, server = ends
    shake(client, server)
    buffers = [memoryview(bytes([i]) * 1000) for i in range(200)]
    assert client.sendmsg(buffers) == PIECE // 1000 * 1000
    assert client.has_unsent
    with pytest.raises(BlockingIOError):
        client.send(b"more")
    got = b""
    while client.has_unsent or not got.endswith(bytes([PIECE // 1000 - 1]) * 1000):
        got += received(server)
        with contextlib.suppress(BlockingIOError):
            client.flush()
    assert got == b"".join(buffers[: PIECE // 1000])


def test_a_handshake_may_come_byte_by_byte_with_data_right_behind_it(identities):
    near, middle = socket.socketpair()
    far, end = socket.socketpair()
    tls = Tls(identities())
    with near, middle, far, end:
        for one in (near, middle, far, end):
            one.setblocking(False)
        client, server = tls.dialled(near), tls.accepted(end)
        client_done = server_done = False
        while not server_done:
            if not client_done and client.shake_hands():
                client_done = True
                client.send(b"hello")
            with contextlib.suppress(BlockingIOError):
                for byte in middle.recv(65536):
                    far.send(bytes([byte]))
                    server_done = server_done or server.shake_hands()
            with contextlib.suppress(BlockingIOError):
                middle.send(far.recv(65536))
        assert received(server) == b"hello"
        with pytest.raises(BlockingIOError):
            server.recv_into(memoryview(bytearray(100_000)))


def test_an_end_is_reported_after_the_last_bytes(ends, pair):
    client, server = ends
    shake(client, server)
    client.send(b"the last")
    client.close()
    pair[0].close()
    assert received(server) == b"the last"
    assert server.recv_into(memoryview(bytearray(100_000))) == 0


def test_a_connection_that_just_ends_has_ended(ends, pair):
    client, server = ends
    shake(client, server)
    pair[0].close()
    assert server.recv_into(memoryview(bytearray(100_000))) == 0


def test_one_that_ends_within_the_handshake_is_an_error(ends, pair):
    client, server = ends
    assert not client.shake_hands()
    pair[0].shutdown(socket.SHUT_WR)
    with pytest.raises(TlsError, match="within the handshake"):
        shake(server)


def test_bytes_changed_on_the_way_are_an_error(identities, pair):
    tls = Tls(identities())
    client, server = tls.dialled(pair[0]), tls.accepted(pair[1])
    shake(client, server)
    pair[0].send(b"\x17\x03\x03\x00\x20" + bytes(32))
    with pytest.raises(TlsError):
        server.recv_into(memoryview(bytearray(100_000)))


@pytest.mark.parametrize(
    ("theirs", "said"),
    [
        ({"name": "other", "fleet": "theirs"}, "self-signed certificate in certificate chain"),
        ({"name": "old", "days": -1}, "expired"),
    ],
    ids=["foreign", "expired"],
)
@pytest.mark.parametrize("dials", [True, False])
def test_both_sides_name_what_is_wrong_with_a_certificate(identities, pair, theirs, said, dials):
    good, bad = Tls(identities()), Tls(identities(**theirs))
    ours, other = (good.accepted, bad.dialled) if dials else (good.dialled, bad.accepted)
    ends = ours(pair[0]), other(pair[1])
    reasons = ["", ""]
    while not all(reasons):
        for i, end in enumerate(ends):
            try:
                if not reasons[i] and end.shake_hands():
                    end.recv_into(memoryview(bytearray(100_000)))
            except BlockingIOError:
                pass
            except TlsError as error:
                reasons[i] = error.strerror
    assert any(said in reason for reason in reasons)


@pytest.mark.parametrize(
    "first", [b"\x50\x01\x00\x00\x0f\x00relay=1", b"\x16\x03\x00\x00\x0f\x00", b"GET /", bytes(9)]
)
def test_who_speaks_no_tls_is_recognised_by_its_first_bytes(ends, pair, first):
    _, server = ends
    pair[0].send(first[:2])
    assert not server.shake_hands()
    pair[0].send(first[2:])
    with pytest.raises(NoTlsError):
        server.shake_hands()
    assert received(pair[0]) == b"", "it hears nothing that it does not understand"


def test_no_connection_header_begins_as_tls_does(ends, pair):
    client, _ = ends
    client.shake_hands()
    assert begins_tls(pair[1].recv(65536))
    assert not any(begins_tls(length.to_bytes(4, "little")) for length in range(65537))
