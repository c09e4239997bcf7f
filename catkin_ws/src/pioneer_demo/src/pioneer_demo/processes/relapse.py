"""Detects nodes that keep dying after each respawn."""

import dataclasses
import signal
from collections import deque
from collections.abc import Hashable

_DEATHS = 3
_WINDOW = 60.0


def ending(status: int) -> str:
    """Returns how a process ended: its exit code, or the signal that ended it."""
    if status < 0:
        return f"killed by {signal.Signals(-status).name}"
    return f"exit code {status}"


@dataclasses.dataclass
class _History:
    name: str
    reason: str = ""
    times: deque[float] = dataclasses.field(default_factory=lambda: deque(maxlen=_DEATHS))
    count: int = 0
    fails: bool = False


class Relapses:
    """Distinguishes single deaths of nodes from repeated ones: three deaths in a minute. Times are monotonic [s]."""

    def __init__(self) -> None:
        self._nodes: dict[Hashable, _History] = {}

    def died(self, key: Hashable, name: str, reason: str, now: float) -> bool:
        """Records a death; returns whether the node counts as dying repeatedly from this death on.

        Args:
            key: identifies the node among nodes of the same name on other masters.
            name: name for messages.
            reason: one line about how and why it died.
            now: the current time.
        """
        node = self._nodes.setdefault(key, _History(name))
        node.times.append(now)
        node.reason, node.count = reason, node.count + 1
        before, node.fails = (
            node.fails,
            node.fails or (len(node.times) == _DEATHS and now - node.times[0] <= _WINDOW),
        )
        return node.fails and not before

    def fails(self, key: Hashable) -> bool:
        """Returns whether that node keeps dying."""
        return key in self._nodes and self._nodes[key].fails

    def recovered(self, now: float) -> list[str]:
        """Forgets nodes that have run for a minute; returns a line for each of them that had kept dying."""
        well = {key: node for key, node in self._nodes.items() if now - node.times[-1] > _WINDOW}
        for key in well:
            del self._nodes[key]
        return [
            f"{node.name} has run for {_WINDOW:.0f} s and no longer keeps dying"
            for node in well.values()
            if node.fails
        ]

    def faults(self) -> list[str]:
        """Returns a line for each node that keeps dying, with the reason of its last death."""
        return [
            f"{node.name} keeps dying and is started again: {node.count} times so far, {node.reason}"
            for node in self._nodes.values()
            if node.fails
        ]
