"""The newest message of a sensor topic is kept; a message that cannot be parsed costs only itself."""

import io
from types import SimpleNamespace

import pytest
from nav_msgs.msg import Odometry

from nav_bundle.costmap import topics as sensor


@pytest.fixture
def odometry(monkeypatch: pytest.MonkeyPatch) -> sensor.Newest[Odometry]:
    """Returns a subscription without a ROS master; ``arrive`` takes the place of the network."""
    found = SimpleNamespace(get_time=lambda: 1.0, logwarn_throttle=lambda *_: None)
    found.Subscriber = lambda _topic, kind, callback, **_: SimpleNamespace(
        kind=kind, callback=callback
    )
    monkeypatch.setattr(sensor, "rospy", found)
    return sensor.Newest("odom", Odometry, 2)


def arrive(newest: sensor.Newest[Odometry], speed: float, cut: int = 0) -> None:
    message, buffer = Odometry(), io.BytesIO()
    message.twist.twist.linear.x = speed
    message.serialize(buffer)
    data = buffer.getvalue()
    subscriber = newest._subscriber
    subscriber.callback(subscriber.kind().deserialize(data[: len(data) - cut]))


def speeds(newest: sensor.Newest[Odometry]) -> list[float]:
    return [arrival.message.twist.twist.linear.x for arrival in newest.arrivals()]


def test_a_message_that_does_not_parse_costs_only_itself(odometry: sensor.Newest[Odometry]) -> None:
    arrive(odometry, 0.5)
    arrive(odometry, 0.7, cut=8)
    assert speeds(odometry) == speeds(odometry) == [0.5]
    arrive(odometry, 0.9)
    assert speeds(odometry) == [0.9]


def test_of_nothing_but_broken_messages_none_is_left(odometry: sensor.Newest[Odometry]) -> None:
    for _ in range(3):
        arrive(odometry, 0.5, cut=8)
    assert speeds(odometry) == []
