"""Computes the data rates of connections from their counters."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from rocon_relay.connection import LinkStatus

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Flow:
    """Average rates on a connection since the previous look."""

    messages: float = 0.0  #: messages per second
    bytes: float = 0.0  #: bytes of messages per second


class Traffic:
    """Converts counters into rates between successive looks."""

    def __init__(self) -> None:
        self._then = 0.0
        self._before: dict[Hashable, LinkStatus] = {}

    def look(self, now: float, links: Mapping[Key, LinkStatus]) -> dict[Key, Flow]:
        """Returns the rates on each connection; zero for a connection seen for the first time."""
        elapsed = max(now - self._then, 1e-3)
        flows = {
            key: _flow(self._before.get(key, link), link, elapsed) for key, link in links.items()
        }
        self._then, self._before = now, dict(links.items())
        return flows


def _flow(before: LinkStatus, now: LinkStatus, elapsed: float) -> Flow:
    # A link that was reconnected counts from 0.
    messages, size = now.messages - before.messages, now.bytes - before.bytes
    return Flow(max(0, messages) / elapsed, max(0, size) / elapsed)
