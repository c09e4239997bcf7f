"""Parses roslaunch's log output about its nodes, and detects nodes that keep dying after each respawn."""

import dataclasses
import re
import signal
from collections import deque
from collections.abc import Hashable

_COLOUR = re.compile(r"\x1b(\[[0-9;]*m|\]2;[^\x07]*\x07)")
_DIED = re.compile(
    r"^(?:\[(?P<name>\S+?)(-\d+)?\] |=*REQUIRED process \[(?P<required>\S+?)(-\d+)?\] has died!\n)"
    r"process has died(?: without exit code)? \[pid (?P<pid>-?\d+)"
    r"(?:, exit code (?P<status>-?\d+))?.*$",
    re.MULTILINE,
)
_RESTART = re.compile(r"^\[(?P<name>\S+?)(-\d+)?\] restarting process", re.MULTILINE)
_LOG = re.compile(r"\A\s*log file: (?P<path>.+)$", re.MULTILINE)
_DEATHS = 3
_WINDOW = 60.0


@dataclasses.dataclass(frozen=True)
class NodeDeath:
    """A node that died."""

    name: str  #: its full name without the leading slash
    pid: int  #: its process id
    status: (
        int | None
    )  #: exit status, negative signal number if a signal ended it; None if roslaunch reports none
    log: str  #: glob pattern of its log files; empty if roslaunch names none


def plain(text: str) -> str:
    """Returns roslaunch's output without escape codes for colours and window titles."""
    return _COLOUR.sub("", text)


def node_deaths(text: str) -> list[NodeDeath]:
    """Returns the node deaths reported in a piece of roslaunch's output, in order."""
    text = plain(text)
    deaths = []
    for match in _DIED.finditer(text):
        log = _LOG.match(text[match.end() :])
        status = int(match["status"]) if match["status"] else None
        deaths.append(
            NodeDeath(
                match["name"] or match["required"],
                int(match["pid"]),
                status,
                log["path"].strip() if log else "",
            )
        )
    return deaths


def restarted_nodes(text: str) -> list[str]:
    """Returns the names of the nodes reported as respawned in a piece of roslaunch's output."""
    return [match["name"] for match in _RESTART.finditer(plain(text))]


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
