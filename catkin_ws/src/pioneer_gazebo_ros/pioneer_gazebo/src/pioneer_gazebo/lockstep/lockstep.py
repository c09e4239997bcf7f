"""Lockstep core (no ROS): which rings take part, which of them a period waits for, and how messages are routed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from pioneer_gazebo.error import SimulatorError

LOCKSTEP = "lockstep"
"""Given in place of a real-time factor."""


class LockstepError(SimulatorError):
    """A member of the lockstep does not respond."""


class Message(Protocol):
    """A message carried by a token: serialised, with its topic and sender."""

    sender: str
    topic: str


@dataclass(eq=False)
class Ring:
    """Nodes that pass a token from one to the next."""

    name: str  #: namespace; empty for the root
    members: tuple[
        str, ...
    ] = ()  #: its nodes, in the order in which they act; empty until it joins
    wants: frozenset[str] = frozenset()  #: topics that its nodes subscribe to
    #: messages for its next token: the last ones published by its own and other rings that it subscribes to
    kept: list[Message] = field(default_factory=list)
    waiting: bool = False  #: whether its token has not returned yet
    told: bool = False  #: whether it has the current lists of members and wanted topics
    awaited: bool = True  #: whether time waits for it to join
    returned: list[Message] = field(default_factory=list)

    @property
    def joined(self) -> bool:
        """Whether the ring takes part."""
        return bool(self.members)


class Lockstep:
    """All rings and the current period."""

    def __init__(self, wanted: Iterable[str] = ()) -> None:
        """Takes the topics that the simulator itself subscribes to."""
        self.period = 0  #: number of the current period; 0 before the first
        self.begun = (
            False  #: whether the first period has begun, once all expected rings had joined
        )
        self.rings: dict[
            str, Ring
        ] = {}  #: by name, in the order in which their messages are processed
        #: topics excluded from all tokens, and rings that exchange no messages with others
        self.withheld: frozenset[str] = frozenset()
        self._own = frozenset(wanted)

    def expect(self, names: Iterable[str]) -> None:
        """Sets the rings that take part; the next period waits for new ones."""
        self.rings = {name: self.rings.get(name) or Ring(name) for name in sorted(names)}
        self._tell_all()

    def subscribe(self, topics: Iterable[str]) -> None:
        """Updates the topics that the simulator itself subscribes to."""
        if self._own != (own := frozenset(topics)):
            self._own = own
            self._tell_all()

    @property
    def absent(self) -> list[Ring]:
        """The expected rings that have not joined."""
        return [ring for ring in self.rings.values() if not ring.joined]

    @property
    def stands(self) -> bool:
        """Whether time stands still: a token has not returned, an awaited ring has not joined, or none is known yet.

        Once time has begun, no rings means that there is nobody to wait for.
        """
        return (not self.begun and not self.rings) or any(
            ring.waiting or (ring.awaited and not ring.joined) for ring in self.rings.values()
        )

    @property
    def late(self) -> list[Ring]:
        """The rings whose token has not returned."""
        return [ring for ring in self.rings.values() if ring.waiting]

    @property
    def members(self) -> list[str]:
        """All nodes that take part."""
        return [member for ring in self.rings.values() for member in ring.members]

    @property
    def wants(self) -> frozenset[str]:
        """All subscribed topics."""
        return self._own.union(*(ring.wants for ring in self.rings.values()))

    def join(self, name: str, members: Sequence[str], wants: Iterable[str]) -> bool:
        """Adds a ring's members; returns whether it is expected and had not joined before."""
        ring = self.rings.get(name)
        if ring is None or ring.joined:
            return False
        ring.members, ring.wants = tuple(members), frozenset(wants)
        self._tell_all()
        return True

    def drop(self, ring: Ring) -> None:
        """Removes a ring's members; it may join again."""
        ring.members, ring.wants, ring.waiting, ring.awaited = (), frozenset(), False, False
        ring.kept, ring.returned = [], []

    def begin_period(self, own: Sequence[Message]) -> list[tuple[Ring, list[Message]]]:
        """Begins the next period; returns each ring with the messages of its token.

        Args:
            own: messages published by the simulator.
        """
        self.period += 1
        self.begun = True
        rounds = []
        for ring in self.rings.values():
            if ring.joined:
                ring.waiting = True
                rounds.append((ring, ring.kept + [one for one in own if self._reaches(one, ring)]))
        return rounds

    def take(self, name: str, period: int, messages: Sequence[Message]) -> bool:
        """Accepts a returned token; returns whether it was the last of the period."""
        ring = self.rings.get(name)
        if ring is None or not ring.waiting or period != self.period:
            return False
        ring.waiting = False
        ring.returned = [one for one in messages if one.sender in ring.members]
        return not self.late

    def end_period(self) -> list[Message]:
        """Keeps the messages each ring subscribes to; returns the simulator's. Order: by ring, then as sent."""
        outside = [ring for ring in self.rings.values() if ring.name not in self.withheld]
        sent = [(ring, one) for ring in outside for one in ring.returned]
        for ring in self.rings.values():
            own = [one for one in ring.returned if one.topic in ring.wants]
            ring.kept = own + [
                one for source, one in sent if source is not ring and self._reaches(one, ring)
            ]
        for ring in self.rings.values():
            ring.returned = []
        return [one for _, one in sent if one.topic in self._own]

    def _reaches(self, message: Message, ring: Ring) -> bool:
        """Returns whether a ring receives a message from outside."""
        return message.topic in ring.wants and not self.withheld & {message.topic, ring.name}

    def _tell_all(self) -> None:
        for ring in self.rings.values():
            ring.told = False
