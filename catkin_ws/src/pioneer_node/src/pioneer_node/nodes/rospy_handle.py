"""The part of the `NodeHandle` interface that adapters use, for nodes that run on rospy."""

import socket
from collections.abc import Callable
from typing import Any

import rospy

from pioneer_node.nodes.exchange import Exchange


class RospyPublisher:
    """A topic that the node publishes."""

    def __init__(self, topic: str, kind: Any) -> None:
        self._publisher = rospy.Publisher(topic, kind, queue_size=10)

    def publish(self, message: Any) -> None:
        """Sends a message to all subscribers."""
        self._publisher.publish(message)

    def reaches(self, node: str) -> bool:
        """Returns whether ``node`` is connected. rospy itself notices a lost subscriber only when it writes."""
        return any(
            one.endpoint_id == node and _stands(one.socket)
            for one in self._publisher.impl.connections
        )


class RospySubscriber:
    """A subscription of the node."""

    def __init__(self, topic: str, kind: Any, take: Callable[[Any, str], object]) -> None:
        self._subscriber = rospy.Subscriber(
            topic, kind, lambda message: take(message, message._connection_header["callerid"])
        )

    def hears(self, node: str) -> bool:
        """Returns whether a publisher of ``node`` is connected."""
        found = self._subscriber.impl.connections if self._subscriber.impl else ()
        return any(one.callerid_pub == node and one.socket is not None for one in found)


class RospyHandle:
    """The node of this process. Callbacks run in rospy's threads."""

    @property
    def name(self) -> str:
        """The node's resolved name."""
        return str(rospy.get_name())

    @property
    def lockstep(self) -> Exchange | None:
        """The message exchange if the node is in lockstep, else None."""
        return Exchange.current

    def stamp(self) -> rospy.Time:
        """Returns ROS time as a message stamp."""
        return rospy.Time.now()

    def advertise(self, topic: str, kind: Any) -> RospyPublisher:
        """Returns a new publisher."""
        return RospyPublisher(topic, kind)

    def subscribe(
        self, topic: str, kind: Any, take: Callable[[Any, str], object]
    ) -> RospySubscriber:
        """Subscribes; calls ``take`` with each message and the name of the node that sent it."""
        return RospySubscriber(topic, kind, take)


def _stands(sock: socket.socket | None) -> bool:
    """Returns whether the peer has kept the connection open. A subscriber sends no data, so a read tells."""
    try:
        return sock is not None and bool(sock.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT))
    except BlockingIOError:
        return True
    except OSError:
        return False
