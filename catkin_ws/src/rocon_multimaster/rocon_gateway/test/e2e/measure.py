"""What can be measured of processes and streams from outside."""

import itertools
import os
from pathlib import Path

MB = 1_000_000


def memory(pid: int) -> int:
    """Resident bytes of a process."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def open_files(pid: int) -> int:
    """How many file descriptors a process has."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def threads(pid: int) -> int:
    """How many threads a process has."""
    return len(list(Path(f"/proc/{pid}/task").iterdir()))


def checked(log: Path) -> list[tuple[float, int, bool]]:
    """Time, number and soundness of each message that a checking probe has had."""
    rows = [line.split() for line in log.read_text().splitlines() if line.endswith(("good", "bad"))]
    return [(float(row[0]), int(row[1]), row[3] == "good") for row in rows]


def longest_gap(times: list[float], since: float) -> float:
    """The longest time between two messages [s], from the last one before `since` on."""
    begin = max((one for one in times if one <= since), default=since)
    return max(late - early for early, late in itertools.pairwise([begin, *(one for one in times if one > since)]))
