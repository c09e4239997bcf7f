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
    """Nodes that pass a token on, one to the next.

    Attributes:
        name: its namespace; empty for the root.
        members: its nodes, in the order in which they act; empty until it has joined.
        wants: topics that they subscribe to.
        kept: what its members and those of other rings published last and it subscribes to, for its next token.
        waiting: whether its token is on the way.
        told: whether it knows who takes part and what is wanted.
    """

    name: str
    members: tuple[str, ...] = ()
    wants: frozenset[str] = frozenset()
    kept: list[Message] = field(default_factory=list)
    waiting: bool = False
    told: bool = False
    returned: list[Message] = field(default_factory=list)

    @property
    def joined(self) -> bool:
        """Whether its nodes take part."""
        return bool(self.members)


class Lockstep:
    """All rings and the period that they are in.

    Attributes:
        period: serial number of the period under way; 0 before the first.
        rings: by name, in the order in which their messages are taken.
        begun: whether the first period has begun: all expected rings had joined.
    """

    def __init__(self, wanted: Iterable[str] = ()) -> None:
        """Takes the topics that the simulator itself subscribes to."""
        self.period = 0
        self.begun = False
        self.rings: dict[str, Ring] = {}
        self._own = frozenset(wanted)

    def expect(self, names: Iterable[str]) -> None:
        """Adds rings that take part as soon as they answer; the first period waits for all of them."""
        for name in sorted(names):
            self.rings.setdefault(name, Ring(name))

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
        """Lets a ring take part; returns whether it did not before."""
        ring = self.rings[name]
        if ring.joined:
            return False
        ring.members, ring.wants = tuple(members), frozenset(wants)
        self._tell_all()
        return True

    def drop(self, ring: Ring) -> None:
        """Takes a ring out; it may join again."""
        ring.members, ring.wants, ring.waiting = (), frozenset(), False
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
                rounds.append((ring, ring.kept + [one for one in own if one.topic in ring.wants]))
        return rounds

    def take(self, name: str, period: int, messages: Sequence[Message]) -> bool:
        """Takes a token that has come back; returns whether it was the last of the period."""
        ring = self.rings[name]
        if not ring.waiting or period != self.period:
            return False
        ring.waiting = False
        ring.returned = [one for one in messages if one.sender in ring.members]
        return not self.late

    def end_period(self) -> list[Message]:
        """Keeps for each ring what it subscribes to; returns what the simulator does. Order: by ring, then as sent."""
        sent = [(ring, one) for ring in self.rings.values() for one in ring.returned]
        for ring in self.rings.values():
            own = [one for one in ring.returned if one.topic in ring.wants]
            ring.kept = own + [one for source, one in sent if source is not ring and one.topic in ring.wants]
        for ring in self.rings.values():
            ring.returned = []
        return [one for _, one in sent if one.topic in self._own]

    def _tell_all(self) -> None:
        for ring in self.rings.values():
            ring.told = False
