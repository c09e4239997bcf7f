"""Reserved ports are free, and each is reserved only once."""

import contextlib
import socket

import pytest

from pioneer_harness.error import PortError
from pioneer_harness.port import PortReservation, is_free


@pytest.fixture
def listener():
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as server:
        yield server.getsockname()[1]


def free_number():
    with PortReservation() as ports:
        return ports.take(20111)


def test_a_port_that_somebody_listens_on_is_not_free(listener):
    assert not is_free(listener)


def test_the_preferred_port_is_taken_when_free():
    port = free_number()
    with PortReservation() as ports:
        assert ports.take(port) == port


def test_two_reservations_never_share_a_port():
    port = free_number()
    with PortReservation() as first, PortReservation() as second:
        assert {first.take(port), second.take(port), second.take(port)} == {
            port,
            port + 1000,
            port + 2000,
        }


def test_a_released_port_can_be_taken_again():
    port = free_number()
    with PortReservation() as ports:
        assert ports.take(port) == port
    with PortReservation() as ports:
        assert ports.take(port) == port


def test_a_busy_preferred_port_gives_one_of_the_next_thousands():
    port = free_number()
    with contextlib.closing(socket.create_server(("127.0.0.1", port))), PortReservation() as ports:
        assert (ports.take(port) - port) % 1000 == 0


def test_no_candidate_left_is_an_error_that_names_the_first():
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as server:
        busy = server.getsockname()[1]  # the kernel picks a port above the last candidate
        with PortReservation() as ports, pytest.raises(PortError, match=str(busy)):
            ports.take(busy)
