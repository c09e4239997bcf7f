"""What crosses between the base station and the robots."""

import dataclasses


@dataclasses.dataclass
class Traffic:
    """Messages and their bytes on the connections of the base station's gateway, since the last `restart`."""

    messages: int = 0  #: in both directions; of a service, calls
    bytes: int = 0  #: of the messages, before compression
    _seen: dict[str, tuple[int, int]] = dataclasses.field(default_factory=dict)

    def add(self, connection: str, messages: int, size: int) -> None:
        """Takes in a connection's counters, which begin again when it is made again."""
        before = self._seen.get(connection, (0, 0))
        if messages < before[0]:
            before = (0, 0)
        self._seen[connection] = (messages, size)
        self.messages += messages - before[0]
        self.bytes += size - before[1]

    def restart(self) -> None:
        """Counts from now on."""
        self.messages = self.bytes = 0
