"""Reads the state of processes from ``/proc``."""

import ctypes
import dataclasses
import math
import os
from collections.abc import Iterable
from pathlib import Path

_TICK = 1.0 / os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")
_PR_SET_CHILD_SUBREAPER = 36
_CONTROL_GROUP = Path("/sys/fs/cgroup")
_libc = ctypes.CDLL(None, use_errno=True)


@dataclasses.dataclass(frozen=True)
class ProcessState:
    """Snapshot of one process."""

    pid: int  #: process id
    parent: int  #: its parent's pid
    session: int  #: pid of its session leader
    alive: bool  #: False for a zombie
    started: int  #: [clock ticks since boot]
    cpu: float  #: [s] user and system time of its own threads
    waited_cpu: float  #: [s] the same for ended descendants that were waited for
    rss: int  #: [bytes] resident memory, shared pages included

    @property
    def key(self) -> tuple[int, int]:
        """Identifies the process even once its pid is reused."""
        return self.pid, self.started


def become_subreaper() -> None:
    """Makes this process the parent of every descendant whose own parent ends (``PR_SET_CHILD_SUBREAPER``).

    Raises:
        OSError: the kernel refuses.
    """
    if _libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_CHILD_SUBREAPER)")


def process_states() -> dict[int, ProcessState]:
    """Returns all visible processes of the machine by pid."""
    states = (process_state(int(name)) for name in os.listdir("/proc") if name.isdigit())
    return {state.pid: state for state in states if state is not None}


def process_state(pid: int) -> ProcessState | None:
    """Returns the state of ``pid``, or None if there is no such process."""
    text = _read(pid, "stat")
    return _state_from_stat(pid, text.decode(errors="replace")) if text else None


def arguments(pid: int) -> tuple[str, ...]:
    """Returns the command line of ``pid``; empty for a zombie, a kernel thread, or a process that does not exist."""
    text = _read(pid, "cmdline")
    return tuple(part.decode(errors="replace") for part in text.split(b"\0")[:-1])


def has_variable(pid: int, name: str, value: str) -> bool:
    """Returns whether ``pid`` was started with the environment variable ``name`` set to ``value``."""
    return f"{name}={value}".encode() in _read(pid, "environ").split(b"\0")


def variable(pid: int, name: str) -> str:
    """Returns the value of the environment variable ``name`` that ``pid`` was started with; empty if it had none."""
    start = f"{name}=".encode()
    for entry in _read(pid, "environ").split(b"\0"):
        if entry.startswith(start):
            return entry[len(start) :].decode(errors="replace")
    return ""


def descendants(states: dict[int, ProcessState], roots: Iterable[int]) -> set[int]:
    """Returns ``roots`` and all their living or zombie descendants among ``states``."""
    children: dict[int, list[int]] = {}
    for state in states.values():
        children.setdefault(state.parent, []).append(state.pid)
    found, open_ = set(), [pid for pid in roots if pid in states]
    while open_:
        pid = open_.pop()
        if pid not in found:
            found.add(pid)
            open_.extend(children.get(pid, ()))
    return found


def processors(control_group: Path = _CONTROL_GROUP) -> float:
    """Returns how many processors this process may use, limited by its affinity and its container's CPU quota."""
    return min(float(len(os.sched_getaffinity(0))), _quota(control_group))


def _quota(control_group: Path) -> float:
    unified, old = control_group / "cpu.max", control_group / "cpu"
    if unified.is_file():
        quota, period = unified.read_text().split()
    elif (old / "cpu.cfs_quota_us").is_file():
        quota, period = (
            (old / f"cpu.cfs_{name}_us").read_text().strip() for name in ("quota", "period")
        )
    else:
        return math.inf
    return math.inf if quota in ("max", "-1") else int(quota) / int(period)


def _read(pid: int, name: str) -> bytes:
    try:
        with open(f"/proc/{pid}/{name}", "rb", buffering=0) as file:
            return file.read()
    except OSError:  # the process has ended, or belongs to another user
        return b""


def _state_from_stat(pid: int, text: str) -> ProcessState:
    # The name is in brackets and may contain anything; the numbers follow the last bracket (proc(5), from field 3).
    fields = text[text.rindex(")") + 2 :].split()
    user, system, waited_user, waited_system = (int(field) for field in fields[11:15])
    return ProcessState(
        pid=pid,
        parent=int(fields[1]),
        session=int(fields[3]),
        alive=fields[0] not in "ZX",
        started=int(fields[19]),
        cpu=(user + system) * _TICK,
        waited_cpu=(waited_user + waited_system) * _TICK,
        rss=int(fields[21]) * _PAGE,
    )
