"""The effect of a link on its packets."""

from pioneer_demo.scenario.link import Condition, Direction


def direction(condition: Condition) -> Direction:
    found = Direction(seed=1)
    found.condition = condition
    return found


def test_a_share_of_packets_is_lost() -> None:
    way = direction(Condition(loss=0.2))
    for number in range(2000):
        way.send(float(number), b"x")
    assert 1500 < len(way.arrived(2000.0)) < 1700


def test_a_cut_link_carries_nothing() -> None:
    way = direction(Condition(loss=1.0))
    way.send(0.0, b"x")
    assert way.due is None


def test_packets_come_late_one_after_another_and_are_dropped_where_too_many_wait() -> None:
    way = direction(Condition(delay=0.5, rate=8000.0))  # 100 bytes take 0.1 s
    for number in range(20):
        way.send(0.0, bytes([number]) * 100)
    assert way.due == 0.6
    assert [packet[0] for packet in way.arrived(0.85)] == [0, 1, 2]
    assert [packet[0] for packet in way.arrived(9.0)] == list(range(3, 11))


def test_packets_keep_their_order_when_the_delay_becomes_less() -> None:
    way = direction(Condition(delay=1.0))
    way.send(0.0, b"first")
    way.condition = Condition()
    way.send(0.1, b"second")
    assert way.arrived(0.5) == []
    assert way.arrived(1.0) == [b"first", b"second"]
