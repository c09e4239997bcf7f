"""Models a network link with limited rate, delay and packet loss."""

import collections
import dataclasses
import random

_LONGEST_QUEUE = 1.0
"""Maximum queueing delay [s]; packets that would wait longer are dropped."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """Condition of a link, applied in each direction."""

    loss: float = 0.0  #: fraction of packets lost
    delay: float = 0.0  #: of each packet [s]
    rate: float = 0.0  #: maximum total rate [bit/s]; 0 for no limit

    def __str__(self) -> str:
        parts = [
            (self.loss, f"{100 * self.loss:g} % loss"),
            (self.delay, f"{self.delay:g} s delay"),
        ]
        return ", ".join(
            text for value, text in [*parts, (self.rate, f"{self.rate:g} bit/s")] if value
        )


class Direction:
    """One direction of a link, with the packets in transit."""

    def __init__(self, seed: int) -> None:
        self.condition = Condition()
        self._random = random.Random(seed)
        self._free = 0.0
        self._under_way = collections.deque[tuple[float, bytes]]()

    @property
    def due(self) -> float | None:
        """Arrival time of the next packet [s]; None if there is none."""
        return self._under_way[0][0] if self._under_way else None

    def send(self, now: float, packet: bytes) -> None:
        """Sends a packet at time ``now`` [s]; packets keep their order."""
        condition = self.condition
        if self._random.random() < condition.loss or self._free - now > _LONGEST_QUEUE:
            return
        self._free = max(self._free, now) + (
            8 * len(packet) / condition.rate if condition.rate else 0.0
        )
        due = self._free + condition.delay
        self._under_way.append(
            (max(due, self._under_way[-1][0]) if self._under_way else due, packet)
        )

    def arrived(self, now: float) -> list[bytes]:
        """Removes and returns the packets that have arrived by time ``now`` [s]."""
        packets = []
        while self._under_way and self._under_way[0][0] <= now:
            packets.append(self._under_way.popleft()[1])
        return packets
