"""The subscriptions of a lockstep member."""

from unittest import mock

import pytest
import rospy
from std_msgs.msg import String

from pioneer_node.nodes import exchange, lockstep


def test_an_inlet_without_connection_is_subscribed_again_after_two_seconds():
    first, second = mock.Mock(), mock.Mock()
    first.get_num_connections.return_value = second.get_num_connections.return_value = 0
    with (
        mock.patch.object(lockstep, "ring_subscriber", side_effect=[first, second]) as subscribe,
        mock.patch.object(lockstep.time, "monotonic", return_value=0.0) as now,
    ):
        link = lockstep.Link("/a/lockstep/period", lambda _token: None)
        now.return_value = 1.9
        link.keep_connected()
        assert subscribe.call_count == 1
        now.return_value = 2.1
        link.keep_connected()
        first.unregister.assert_called_once_with()
        assert subscribe.call_count == 2
        second.get_num_connections.return_value = 1
        now.return_value = 60.0
        link.keep_connected()
        now.return_value = 61.0
        second.get_num_connections.return_value = 0
        link.keep_connected()
    assert not second.unregister.called


def test_a_latched_message_that_a_new_link_brings_again_is_ignored():
    def hear(text, latching, sender="/map_server"):
        message = String(text)
        message._connection_header = {"callerid": sender, "latching": latching}
        subscriber._hear(message)

    heard = []
    with (
        mock.patch.object(exchange.Exchange, "current", exchange.Exchange("/a")),
        mock.patch.object(rospy.topics.Subscriber, "__init__"),
    ):
        subscriber = exchange._Subscriber(
            "/map", String, lambda message: heard.append(message.data)
        )
        subscriber.resolved_name = "/map"
        for text, latching in (
            ("one", "1"),
            ("one", "1"),
            ("two", "1"),
            ("three", "0"),
            ("three", "0"),
        ):
            hear(text, latching)
        hear("two", "1", "/another")
    assert heard == ["one", "two", "three", "three", "two"]


def test_a_node_whose_work_fails_is_stopped_before_the_error_is_raised():
    class Node:
        stopped = False

        def step(self):
            raise AssertionError("called by tokens only")

        def stop(self):
            self.stopped = True

    node = Node()
    member = mock.Mock()
    member.spin.side_effect = RuntimeError("the work failed")
    with pytest.raises(RuntimeError, match="the work failed"):
        lockstep.Turns(member, node).spin()
    assert node.stopped
