"""Whether a connection that rospy still holds is really open."""

import socket

from pioneer_node.nodes.rospy_handle import _stands


def test_a_connection_stands_until_the_other_end_closes_it() -> None:
    """A goal for a new move_base went to the old one's socket: rospy notices a closed connection only on write."""
    ours, theirs = socket.socketpair()
    with ours:
        assert _stands(ours)
        theirs.close()
        assert not _stands(ours)
    assert not _stands(ours)
    assert not _stands(None)
