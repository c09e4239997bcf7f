"""Measurements of processes and message streams from outside."""

import itertools
import os
from pathlib import Path

MB = 1_000_000


def memory(pid: int) -> int:
    """Returns the resident memory of a process [bytes]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def open_files(pid: int) -> int:
    """Returns the number of open file descriptors of a process."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def threads(pid: int) -> int:
    """Returns the number of threads of a process."""
    return len(list(Path(f"/proc/{pid}/task").iterdir()))


def checked(log: Path) -> list[tuple[float, int, bool]]:
    """Returns time, number and validity of each message that a `check` probe has received."""
    rows = [line.split() for line in log.read_text().splitlines() if line.endswith(("good", "bad"))]
    return [(float(row[0]), int(row[1]), row[3] == "good") for row in rows]


def longest_gap(times: list[float], since: float) -> float:
    """Returns the longest gap between two messages [s], starting with the last one before `since`."""
    begin = max((one for one in times if one <= since), default=since)
    return max(
        late - early
        for early, late in itertools.pairwise([begin, *(one for one in times if one > since)])
    )
