"""Makes a `NodeHandle` a ring member that runs in lockstep with the simulator (docs/lockstep.md)."""

from collections.abc import Callable, Sequence
from typing import Any

from pioneer_msgs.msg import LockstepMessage, LockstepToken

from pioneer_node.adapters.exchange import Exchange, Place, is_connected
from pioneer_node.adapters.node_handle import NodeHandle, Publisher, Received
from tcpros.topic_source import Sender


class HandleMember:
    """A node's place in its ring. Tokens are handled in the process's only thread, like all other work of the node.

    Subscribes: ``lockstep/period``, or ``lockstep/after_NAME`` of the previous member (pioneer_msgs/LockstepToken),
        ``lockstep/probe``.

    Publishes: ``lockstep/done``, or ``lockstep/after_NAME`` for the next member.
    """

    def __init__(self, handle: NodeHandle, ring: str, members: Sequence[str], name: str) -> None:
        """Takes the node, the ring's name, its members in the order of their turns, and this member's name."""
        self._exchange = Exchange(handle.name)
        self._place = place = Place(
            self._exchange,
            ring,
            members,
            name,
            lambda stamp: handle.set_time(float(stamp.to_sec())),
        )
        place.step = self._step
        self._ticks: list[Callable[[], object]] = []
        # Tokens themselves travel over TCPROS connections.
        self._outlet = handle.advertise(place.outlet, LockstepToken)
        self._answers = (
            self._outlet
            if place.answers == place.outlet
            else handle.advertise(place.answers, LockstepToken)
        )
        handle.subscribe(place.inlet, LockstepToken, self._take)
        handle.subscribe(place.probe, LockstepToken, self._answer)
        handle.join(self)

    def wants(self, topic: str) -> bool:
        """Returns whether any node in lockstep subscribes to a topic."""
        return self._exchange.wants(topic)

    def note(self, publisher: Publisher, data: bytes) -> None:
        """Records a message that the node publishes, for the next token."""
        latched_by = id(publisher) if publisher.latched else None
        self._exchange.publish(publisher.topic, data, latched_by)

    def listen(self, topic: str, kind: Any, take: Received) -> bool:
        """Calls ``take`` for each message in tokens; returns whether connections carry the topic as well."""

        def receive(message: LockstepMessage) -> None:
            take(message.data, message.sender)

        self._exchange.listen(topic, receive)
        return is_connected(kind, topic)

    def takes(self, topic: str, sender: Sender, data: memoryview) -> bool:
        """Returns whether to accept a message received over a connection."""
        return self._exchange.accepts(topic, sender.original, sender.latching, lambda: bytes(data))

    def tick(self, call: Callable[[], object]) -> None:
        """Registers ``call`` to run once per period."""
        self._ticks.append(call)

    def _step(self) -> None:
        for call in self._ticks:
            call()

    def _take(self, token: LockstepToken, _sender: str) -> None:
        passed_on = self._place.take(token)
        if passed_on is not None:
            self._outlet.publish(passed_on)

    def _answer(self, probe: LockstepToken, _sender: str) -> None:
        self._answers.publish(self._place.answer(probe))
