"""Lockstep: which rings of nodes take part, whom a period waits for, and which message goes where (no ROS)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from pioneer_gazebo.core.error import SimulatorError

LOCKSTEP = "lockstep"
"""In the place of a real-time factor."""


class LockstepError(SimulatorError):
    """A member of lockstep does not answer."""


class Message(Protocol):
    """What a token carries: a serialised message, its topic and its sender."""

    sender: str
    topic: str


@dataclass(eq=False)
class Ring:
    """Nodes that pass a token on, one to the next."""

    name: str  #: its namespace; empty for the root
    members: tuple[str, ...] = ()  #: its nodes, in the order in which they act; empty until it has joined
    wants: frozenset[str] = frozenset()  #: topics that they subscribe to
    #: what its members and those of other rings published last and it subscribes to, for its next token
    kept: list[Message] = field(default_factory=list)
    waiting: bool = False  #: whether its token is on the way
    told: bool = False  #: whether it knows who takes part and what is wanted
    awaited: bool = True  #: whether time stands until it has joined
    returned: list[Message] = field(default_factory=list)

    @property
    def joined(self) -> bool:
        """Whether its nodes take part."""
        return bool(self.members)


class Lockstep:
    """All rings and the period that they are in."""

    def __init__(self, wanted: Iterable[str] = ()) -> None:
        """Takes the topics that the simulator itself subscribes to."""
        self.period = 0  #: serial number of the period under way; 0 before the first
        self.begun = False  #: whether the first period has begun: all expected rings had joined
        self.rings: dict[str, Ring] = {}  #: by name, in the order in which their messages are taken
        #: topics of which no token has messages, and rings to and from which nothing passes
        self.withheld: frozenset[str] = frozenset()
        self._own = frozenset(wanted)

    def expect(self, names: Iterable[str]) -> None:
        """Has these rings take part, and no others; the next period waits for those that are new."""
        self.rings = {name: self.rings.get(name) or Ring(name) for name in sorted(names)}
        self._tell_all()

    def subscribe(self, topics: Iterable[str]) -> None:
        """Takes the topics that the simulator itself subscribes to by now."""
        if self._own != (own := frozenset(topics)):
            self._own = own
            self._tell_all()

    @property
    def absent(self) -> list[Ring]:
        """The rings that are expected and do not take part."""
        return [ring for ring in self.rings.values() if not ring.joined]

    @property
    def stands(self) -> bool:
        """Whether time stands: a token is on the way, or a ring that is waited for has not joined."""
        return not self.rings or any(ring.waiting or (ring.awaited and not ring.joined) for ring in self.rings.values())

    @property
    def late(self) -> list[Ring]:
        """The rings whose token is on the way."""
        return [ring for ring in self.rings.values() if ring.waiting]

    @property
    def members(self) -> list[str]:
        """All nodes that take part."""
        return [member for ring in self.rings.values() for member in ring.members]

    @property
    def wants(self) -> frozenset[str]:
        """The topics that anybody subscribes to."""
        return self._own.union(*(ring.wants for ring in self.rings.values()))

    def join(self, name: str, members: Sequence[str], wants: Iterable[str]) -> bool:
        """Lets a ring take part; returns whether it did not before, and is expected."""
        ring = self.rings.get(name)
        if ring is None or ring.joined:
            return False
        ring.members, ring.wants = tuple(members), frozenset(wants)
        self._tell_all()
        return True

    def drop(self, ring: Ring) -> None:
        """Takes a ring out; it may join again."""
        ring.members, ring.wants, ring.waiting, ring.awaited = (), frozenset(), False, False
        ring.kept, ring.returned = [], []

    def begin_period(self, own: Sequence[Message]) -> list[tuple[Ring, list[Message]]]:
        """Begins the next period; returns each ring with the messages of its token.

        Args:
            own: what the simulator has published.
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
        """Takes a token that has come back; returns whether it was the last of the period."""
        ring = self.rings.get(name)
        if ring is None or not ring.waiting or period != self.period:
            return False
        ring.waiting = False
        ring.returned = [one for one in messages if one.sender in ring.members]
        return not self.late

    def end_period(self) -> list[Message]:
        """Keeps for each ring what it subscribes to; returns what the simulator does. Order: by ring, then as sent."""
        outside = [ring for ring in self.rings.values() if ring.name not in self.withheld]
        sent = [(ring, one) for ring in outside for one in ring.returned]
        for ring in self.rings.values():
            own = [one for one in ring.returned if one.topic in ring.wants]
            ring.kept = own + [one for source, one in sent if source is not ring and self._reaches(one, ring)]
        for ring in self.rings.values():
            ring.returned = []
        return [one for _, one in sent if one.topic in self._own]

    def _reaches(self, message: Message, ring: Ring) -> bool:
        """Returns whether a ring gets a message from outside."""
        return message.topic in ring.wants and not self.withheld & {message.topic, ring.name}

    def _tell_all(self) -> None:
        for ring in self.rings.values():
            ring.told = False
