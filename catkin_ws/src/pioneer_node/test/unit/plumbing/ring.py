"""A lockstep ring of `NodeHandle`s on the simulated network, and the gate that sends its tokens round.

Each message of a member must reach every member exactly once, in order, whatever tokens get lost and sent again.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from pioneer_msgs.msg import LockstepToken
from rospy import Time
from std_msgs.msg import String

from pioneer_node.adapters.handle_lockstep import HandleMember
from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.core.ring import INLET, OUTLET, PROBE, ring_topic

if TYPE_CHECKING:
    from plumbing_world import World

RING = "ring"
MEMBERS = ("first", "second", "third")
TOPICS = ("/ring/x", "/ring/y", "/ring/latched")
PAUSES = (0.05, 0.5, 2.0)
"""Between two periods [s]."""
ASK_EVERY, RESEND_AFTER = 0.2, 1.0
"""How soon the gate asks members to join, and sends a token again [s]."""
SIZES = (0, 1, 100, 5_000, 131_073, 300_000)
LARGEST = 20_000_000

_HEAD = struct.Struct("<III")
"""Of a message: its number among those of its sender on its topic, size and checksum of the rest."""


class RingMember:
    """A node of the ring: it publishes at each step, and checks what tokens bring."""

    def __init__(self, world: World, name: str) -> None:
        self.name = f"/{RING}/{name}"
        self.is_closed = False
        self.sent: dict[str, int] = defaultdict(int)  #: number of messages by topic
        #: number of the last message by topic and sender
        self.received: dict[tuple[str, str], int] = defaultdict(int)
        self.steps = 0
        self._world = world
        self.handle = NodeHandle(world.context, self.name, {}, self._shut_down)
        self.lockstep = HandleMember(self.handle, RING, MEMBERS, name)
        self._publishers = {
            topic: self.handle.advertise(topic, String, latch="latched" in topic)
            for topic in TOPICS
        }
        for topic in TOPICS:
            self.handle.subscribe_serialised(topic, String, partial(self._take, topic))
        self.handle.every(0.05, self._step)

    def publish(self, topic: str, size: int) -> None:
        """Publishes a message of this size."""
        self.sent[topic] += 1
        body = self._world.body(size)
        head = _HEAD.pack(self.sent[topic], size, zlib.adler32(body))
        self._publishers[topic].send(struct.pack("<I", len(head) + size) + head + body)

    def close(self) -> None:
        """Ends the node."""

        def closed() -> None:
            self.is_closed = True

        self.handle.close(closed)

    def _shut_down(self, reason: str) -> None:
        self._world.complain(f"{self.name} was shut down: {reason}")

    def _step(self) -> None:
        self.steps += 1
        if self._world.ring.is_quiet:
            return
        drawn = self._world.drawn
        for _ in range(drawn.choice((0, 0, 1, 3))):
            size = LARGEST if drawn.random() < 0.001 else drawn.choice(SIZES)
            self.publish(drawn.choice(TOPICS), size)

    def _take(self, topic: str, data: Any, sender: str) -> None:
        number, size, checksum = _HEAD.unpack_from(data)
        body = data[_HEAD.size :]
        if len(body) != size or zlib.adler32(body) != checksum:
            self._world.complain(f"a damaged message on {topic} from {sender} in the ring")
        before = self.received[topic, sender]
        if number != before + 1:
            self._world.complain(f"{self.name} got {topic} {number} of {sender} after {before}")
        self.received[topic, sender] = number


class Gate:
    """Sends tokens round as the simulator does: a period begins when the token of the former has returned."""

    def __init__(self, world: World) -> None:
        self.period = 0
        self.is_closed = False
        self.handle = NodeHandle(world.context, "/gate", {}, self._shut_down)
        self._world = world
        self._joined: LockstepToken | None = None
        self._token: LockstepToken | None = None
        self._inlet = self.handle.advertise(ring_topic(RING, INLET), LockstepToken)
        self.handle.advertise(ring_topic(RING, PROBE), LockstepToken)
        self.handle.subscribe(ring_topic(RING, OUTLET), LockstepToken, self._take)
        self._ask()

    def close(self) -> None:
        """Ends the node."""
        self._token = None

        def closed() -> None:
            self.is_closed = True

        self.handle.close(closed)

    def _shut_down(self, reason: str) -> None:
        self._world.complain(f"the gate was shut down: {reason}")

    def _later(self, seconds: float, call: Callable[[], object]) -> None:
        self._world.reactor.call_later(seconds, call)

    def _ask(self) -> None:
        if self._joined is None and not self._world.ring.is_over:
            self._inlet.publish(LockstepToken(LockstepToken.JOIN, 0, Time(), [], [], []))
            self._later(ASK_EVERY, self._ask)

    def _take(self, token: LockstepToken, _sender: str) -> None:
        if token.kind == LockstepToken.JOIN:
            if self._joined is None:
                self._joined = token
                self._begin(token.members, token.wants, [])
            return
        if self._token is None or token.period != self.period:
            return
        self._token = None
        begin = partial(self._begin, [], [], token.messages)
        self._later(self._world.drawn.choice(PAUSES), begin)

    def _begin(self, members: list[str], wants: list[str], messages: list[Any]) -> None:
        if self._world.ring.is_over:
            return
        self.period += 1
        stamp = Time(self.period)
        kind = LockstepToken.PERIOD
        self._token = LockstepToken(kind, self.period, stamp, members, wants, messages)
        self._send(self.period, RESEND_AFTER)

    def _send(self, period: int, after: float) -> None:
        if self._token is not None and period == self.period and not self._world.ring.is_over:
            self._inlet.publish(self._token)
            self._later(after, partial(self._send, period, min(2 * after, 8.0)))


class Ring:
    """The gate and the members."""

    def __init__(self, world: World) -> None:
        self.is_quiet = self.is_over = False
        world.ring = self
        self.members = [RingMember(world, name) for name in MEMBERS]
        self.gate = Gate(world)

    @property
    def nodes(self) -> list[RingMember | Gate]:
        """All nodes."""
        return [*self.members, self.gate]

    def publishers(self) -> list[tuple[str, str]]:
        """Returns what is to be registered: topic and node."""
        last = self.members[-1].name
        found = [("/gate", ring_topic(RING, INLET)), ("/gate", ring_topic(RING, PROBE))]
        for member, name in zip(self.members, MEMBERS, strict=True):
            found += [(member.name, topic) for topic in (*TOPICS, ring_topic(RING, OUTLET))]
            if member.name != last:
                found.append((member.name, ring_topic(RING, f"after_{name}")))
        return [(topic, node) for node, topic in found]

    def subscribers(self) -> list[tuple[str, str]]:
        """Returns what is to be registered: topic and node."""
        found = [(ring_topic(RING, OUTLET), "/gate")]
        inlet = ring_topic(RING, INLET)
        for member, name in zip(self.members, MEMBERS, strict=True):
            found += [(topic, member.name) for topic in (*TOPICS, inlet, ring_topic(RING, PROBE))]
            inlet = ring_topic(RING, f"after_{name}")
        return found

    def missing(self) -> list[str]:
        """Returns the messages that members have not got, and steps that they have not made."""
        found = [
            f"{receiver.name} has {receiver.received[topic, sender.name]} of {count} {topic} of {sender.name}"
            for sender in self.members
            for topic, count in sender.sent.items()
            for receiver in self.members
            if receiver.received[topic, sender.name] != count
        ]
        return found + [
            f"{member.name} has made {member.steps} of {self.gate.period} steps"
            for member in self.members
            if member.steps not in (self.gate.period, self.gate.period - 1)
        ]
