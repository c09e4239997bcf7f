"""The way of packets over a link that is slow, late or lossy."""

import collections
import dataclasses
import random

_LONGEST_QUEUE = 1.0
"""A packet that would wait longer for those before it [s] is dropped."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """What a link does to each packet, in each direction."""

    loss: float = 0.0  #: share of packets that are lost
    delay: float = 0.0  #: of each packet [s]
    rate: float = 0.0  #: of all packets [bit/s]; 0 for any

    def __str__(self) -> str:
        parts = [(self.loss, f"{100 * self.loss:g} % loss"), (self.delay, f"{self.delay:g} s delay")]
        return ", ".join(text for value, text in [*parts, (self.rate, f"{self.rate:g} bit/s")] if value)


class Direction:
    """Packets that are on their way in one direction."""

    def __init__(self, seed: int) -> None:
        self.condition = Condition()
        self._random = random.Random(seed)
        self._free = 0.0
        self._under_way = collections.deque[tuple[float, bytes]]()

    @property
    def due(self) -> float | None:
        """When the next packet arrives [s]; None for none."""
        return self._under_way[0][0] if self._under_way else None

    def send(self, now: float, packet: bytes) -> None:
        """Takes a packet in at a time [s]; packets keep their order."""
        condition = self.condition
        if self._random.random() < condition.loss or self._free - now > _LONGEST_QUEUE:
            return
        self._free = max(self._free, now) + (8 * len(packet) / condition.rate if condition.rate else 0.0)
        due = self._free + condition.delay
        self._under_way.append((max(due, self._under_way[-1][0]) if self._under_way else due, packet))

    def arrived(self, now: float) -> list[bytes]:
        """Returns the packets that have arrived by a time [s], and forgets them."""
        packets = []
        while self._under_way and self._under_way[0][0] <= now:
            packets.append(self._under_way.popleft()[1])
        return packets
