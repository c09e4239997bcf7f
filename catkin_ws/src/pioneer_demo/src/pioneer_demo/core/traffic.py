"""Counts network traffic between the base station and the robots."""

import dataclasses


@dataclasses.dataclass
class Traffic:
    """Message and byte counts on the base station's gateway connections since the last `restart`."""

    messages: int = 0  #: in both directions; calls for services
    bytes: int = 0  #: size of the messages before compression
    _seen: dict[str, tuple[int, int]] = dataclasses.field(default_factory=dict)

    def add(self, connection: str, messages: int, size: int) -> None:
        """Adds a connection's counters, which restart from 0 when it reconnects."""
        before = self._seen.get(connection, (0, 0))
        if messages < before[0]:
            before = (0, 0)
        self._seen[connection] = (messages, size)
        self.messages += messages - before[0]
        self.bytes += size - before[1]

    def restart(self) -> None:
        """Resets the counts to 0."""
        self.messages = self.bytes = 0
