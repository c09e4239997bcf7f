"""What flows on connections, from their counters."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from rocon_relay.core.connection import LinkStatus

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Flow:
    """What a connection carried since it was last looked at."""

    messages: float = 0.0  #: a second
    bytes: float = 0.0  #: of the messages, a second


class Traffic:
    """Turns counters into rates, from one look to the next."""

    def __init__(self) -> None:
        self._then = 0.0
        self._before: dict[Hashable, LinkStatus] = {}

    def look(self, now: float, links: Mapping[Key, LinkStatus]) -> dict[Key, Flow]:
        """Returns how much flows on each connection; nothing yet on one that is looked at for the first time."""
        elapsed = max(now - self._then, 1e-3)
        flows = {key: _flow(self._before.get(key, link), link, elapsed) for key, link in links.items()}
        self._then, self._before = now, dict(links.items())
        return flows


def _flow(before: LinkStatus, now: LinkStatus, elapsed: float) -> Flow:
    # A link that was reconnected counts from 0.
    messages, size = now.messages - before.messages, now.bytes - before.bytes
    return Flow(max(0, messages) / elapsed, max(0, size) / elapsed)
