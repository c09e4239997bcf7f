"""Parses roslaunch's log output about its nodes."""

import dataclasses
import re

_COLOUR = re.compile(r"\x1b(\[[0-9;]*m|\]2;[^\x07]*\x07)")
_DIED = re.compile(
    r"^\[(?P<name>\S+?)(-\d+)?\] process has died(?: without exit code)? \[pid (?P<pid>-?\d+)"
    r"(?:, exit code (?P<status>-?\d+))?.*$",
    re.MULTILINE,
)
_RESTART = re.compile(r"^\[(?P<name>\S+?)(-\d+)?\] restarting process", re.MULTILINE)
_LOG = re.compile(r"\A\s*log file: (?P<path>.+)$", re.MULTILINE)


@dataclasses.dataclass(frozen=True)
class NodeDeath:
    """A node that died."""

    name: str  #: its full name without the leading slash
    pid: int  #: its process id
    status: int | None  #: exit status, negative signal number if a signal ended it; None if roslaunch reports none
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
        deaths.append(NodeDeath(match["name"], int(match["pid"]), status, log["path"].strip() if log else ""))
    return deaths


def restarted_nodes(text: str) -> list[str]:
    """Returns the names of the nodes reported as respawned in a piece of roslaunch's output."""
    return [match["name"] for match in _RESTART.finditer(plain(text))]
