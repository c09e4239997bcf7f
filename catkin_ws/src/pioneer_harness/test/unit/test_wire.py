"""A wire loses, delays, reorders, limits and cuts as told."""

import socket
import time

import pytest

from pioneer_harness.wire import Condition, Way, WiredMachine, WireError


def sent(condition: Condition, sizes: list[int]) -> list[tuple[float, bytes]]:
    """Returns arrival time and packet of each packet that arrives, one sent every millisecond."""
    way = Way(1)
    way.condition = condition
    arrived = []
    for step in range(5000):
        now = step / 1000
        if step < len(sizes):
            way.send(now, step.to_bytes(2, "big") + b"x" * (sizes[step] - 2))
        arrived += [(now, packet) for packet in way.arrived(now)]
    assert way.due is None
    return arrived


def order(arrived: list[tuple[float, bytes]]) -> list[int]:
    return [int.from_bytes(packet[:2], "big") for _, packet in arrived]


def test_a_good_wire_passes_everything_in_order() -> None:
    assert order(sent(Condition(), [100] * 50)) == list(range(50))


def test_a_lossy_wire_loses_its_share() -> None:
    assert 650 < len(sent(Condition(loss=0.3), [100] * 1000)) < 750


def test_delay_keeps_the_order_and_jitter_does_not() -> None:
    late = sent(Condition(delay=0.2), [100] * 50)
    assert order(late) == list(range(50))
    assert late[0][0] == pytest.approx(0.2, abs=0.002)
    mixed = order(sent(Condition(jitter=0.05), [100] * 50))
    assert mixed != sorted(mixed) == list(range(50))


def test_a_narrow_wire_keeps_its_rate_and_drops_what_would_wait_too_long() -> None:
    arrived = sent(Condition(rate=1e6), [1000] * 1000)
    times = [moment for moment, _ in arrived]
    assert 8000 * len(arrived) / (times[-1] - times[0]) == pytest.approx(1e6, rel=0.05)
    assert len(arrived) < 250


def test_long_packets_and_cut_ways_swallow() -> None:
    assert order(sent(Condition(mtu=1000), [1000, 1001, 1000])) == [0, 2]
    assert not sent(Condition(cut=True), [100] * 10)


def test_a_wired_machine_is_reached_and_can_be_cut() -> None:
    try:
        machine = WiredMachine()
    except WireError as error:
        pytest.skip(f"no wires here: {error}")

    def answers() -> bool:
        """Returns whether a port where nothing listens refuses a connection."""
        try:
            socket.create_connection((machine.there, 9), 0.8).close()
        except ConnectionRefusedError:
            return True
        except OSError:
            return False
        return True

    try:
        assert answers()
        machine.set(Condition(delay=0.1))
        began = time.monotonic()
        assert answers()
        assert time.monotonic() - began >= 0.2
        machine.set(Condition(cut=True), Condition())
        assert not answers()
        machine.set(Condition())
        assert answers()
    finally:
        machine.close()
