"""Accounts CPU time and memory of a process tree by kind, including processes that have ended."""

import dataclasses
from collections.abc import Callable, Iterable, Sequence

from pioneer_harness.proc import ProcessState

KindOf = Callable[[Sequence[str]], str]


@dataclasses.dataclass(frozen=True)
class Usage:
    """Resource usage of all processes of one kind."""

    cpu: float  #: [s] user and system time since their start
    rss: int  #: [bytes] peak over the samples of the summed resident memory; shared pages count in each process
    processes: int  #: number of processes seen


@dataclasses.dataclass
class _Record:
    kind: str
    state: ProcessState
    ended: bool = False


class Account:
    """Adds up samples of processes.

    An ended process keeps the CPU time of its last sample. Children that lived only between two samples show up only in
    their parent's waited-for time: the part of it that known children do not explain counts as kind ``short``.
    """

    def __init__(self, kind_of: KindOf, short: str = "other") -> None:
        self._kind_of = kind_of
        self._short = short
        self._records: dict[tuple[int, int], _Record] = {}
        self._peak_rss: dict[str, int] = {}

    def add(self, states: Iterable[ProcessState], arguments_of: Callable[[int], Sequence[str]]) -> None:
        """Adds one sample: all processes of the tree that exist now."""
        seen = set()
        for state in states:
            key = (state.pid, state.started)
            seen.add(key)
            self._update(key, state, arguments_of)
        for key, record in self._records.items():
            record.ended = key not in seen
        self._note_rss()

    def usage(self) -> dict[str, Usage]:
        """Returns each kind's usage up to the last sample."""
        cpu: dict[str, float] = {}
        count: dict[str, int] = {}
        for record in self._records.values():
            cpu[record.kind] = cpu.get(record.kind, 0.0) + record.state.cpu
            count[record.kind] = count.get(record.kind, 0) + 1
        cpu[self._short] = cpu.get(self._short, 0.0) + self._unseen_cpu()
        return {
            kind: Usage(seconds, self._peak_rss.get(kind, 0), count.get(kind, 0))
            for kind, seconds in sorted(cpu.items())
        }

    def _update(self, key: tuple[int, int], state: ProcessState, arguments_of: Callable[[int], Sequence[str]]) -> None:
        record = self._records.get(key)
        if not state.alive:  # a zombie has no command line, but still its final CPU times
            if record is not None:
                record.state = dataclasses.replace(state, rss=0)
            return
        # exec keeps the pid and changes the command line, so the kind is read again each time.
        kind = self._kind_of(arguments_of(state.pid))
        self._records[key] = _Record(kind, state)

    def _note_rss(self) -> None:
        now: dict[str, int] = {}
        for record in self._records.values():
            if not record.ended:
                now[record.kind] = now.get(record.kind, 0) + record.state.rss
        for kind, rss in now.items():
            self._peak_rss[kind] = max(rss, self._peak_rss.get(kind, 0))

    def _unseen_cpu(self) -> float:
        ended: dict[int, float] = {}
        for record in self._records.values():
            if record.ended:
                spent = record.state.cpu + record.state.waited_cpu
                ended[record.state.parent] = ended.get(record.state.parent, 0.0) + spent
        return sum(
            max(0.0, record.state.waited_cpu - ended.get(record.state.pid, 0.0)) for record in self._records.values()
        )
