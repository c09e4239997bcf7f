"""What is kept of a latched topic for new subscribers."""

from typing import NamedTuple

from rocon_relay.sieve import TF_TYPES, transforms_in
from tcpros.fanout import Latch
from tcpros.frame import LENGTH_SIZE

MAX_BYTES = 4 * 2**20
"""Maximum size of the kept tf messages of one publisher [bytes]; beyond it, the oldest are dropped."""


def latch_for(type_: str) -> Latch:
    """Returns what keeps the latched messages of a topic of this type."""
    return TransformLatch() if type_ in TF_TYPES else Latch()


class _Kept(NamedTuple):
    frame: memoryview
    children: frozenset[str]


class TransformLatch(Latch):
    """Keeps the last tf message of each child frame.

    A node may have several latched publishers of `/tf_static` (nodelets, static broadcasters in one C++ process). All
    of them use one connection, on which a new subscriber gets the last message of each. Which publisher sent a message
    does not show, but its child frames do.
    """

    def __init__(self) -> None:
        super().__init__()
        self._kept: list[_Kept] = []

    def keep(self, frame: memoryview) -> None:
        """Takes a new message; drops those whose child frames all have a newer transform."""
        message = bytes(frame)
        children = frozenset(child for child, *_ in transforms_in(message[LENGTH_SIZE:]))
        if not children:
            return
        newest_first = [_Kept(memoryview(message), children), *reversed(self._kept)]
        kept: list[_Kept] = []
        seen: set[str] = set()
        size = 0
        for one in newest_first:
            if one.children <= seen:
                continue
            size += len(one.frame)
            if size > MAX_BYTES and kept:
                break
            kept.append(one)
            seen |= one.children
        self._kept = kept[::-1]

    @property
    def frames(self) -> list[memoryview]:
        """The kept messages, oldest first."""
        return [one.frame for one in self._kept]
