"""Whether a connection that rospy still has stands."""

import socket

from pioneer_node.nodes.rospy_handle import _stands


def test_a_connection_stands_until_the_other_end_closes_it() -> None:
    """A goal for the next move_base went to the last one's socket, as rospy sees an end only when it writes."""
    ours, theirs = socket.socketpair()
    with ours:
        assert _stands(ours)
        theirs.close()
        assert not _stands(ours)
    assert not _stands(ours)
    assert not _stands(None)
