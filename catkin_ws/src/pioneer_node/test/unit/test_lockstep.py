"""A member's subscriptions of tokens."""

from unittest import mock

from pioneer_node.nodes import lockstep


def test_an_inlet_without_connection_is_subscribed_again_after_two_seconds():
    first, second = mock.Mock(), mock.Mock()
    first.get_num_connections.return_value = second.get_num_connections.return_value = 0
    with (
        mock.patch.object(lockstep, "ring_subscriber", side_effect=[first, second]) as subscribe,
        mock.patch.object(lockstep.time, "monotonic", return_value=0.0) as now,
    ):
        link = lockstep._Link("/a/lockstep/period", lambda _token: None)
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
