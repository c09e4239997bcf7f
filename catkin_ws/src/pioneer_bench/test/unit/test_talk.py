"""The publisher of the gateway bench sends while it has subscribers, and shuts down."""

from pioneer_bench.nodes.talk import Demand


def test_it_waits_while_nobody_subscribes() -> None:
    demand = Demand()
    assert not demand.is_there.is_set()
    demand.peer_subscribe("/topic", None, None)
    assert demand.is_there.is_set()
    demand.peer_unsubscribe("/topic", 1)
    assert demand.is_there.is_set()
    demand.peer_unsubscribe("/topic", 0)
    assert not demand.is_there.is_set()


def test_a_subscriber_that_leaves_during_the_shutdown_does_not_keep_it_waiting() -> None:
    demand = Demand()
    demand.peer_subscribe("/topic", None, None)
    demand.end()
    demand.peer_unsubscribe("/topic", 0)
    assert demand.is_there.is_set()
