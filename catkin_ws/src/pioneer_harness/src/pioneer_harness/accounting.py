"""Accounts CPU time and memory of a process tree by kind, including processes that have ended."""

import collections
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
        self._peak_rss = collections.Counter[str]()

    def add(
        self, states: Iterable[ProcessState], arguments_of: Callable[[int], Sequence[str]]
    ) -> None:
        """Adds one sample: all processes of the tree that exist now."""
        sample = {state.key: state for state in states}
        for key, state in sample.items():
            if state.alive:
                # exec keeps the pid and changes the command line, so the kind is read again each time.
                self._records[key] = _Record(self._kind_of(arguments_of(state.pid)), state)
            elif (
                key in self._records
            ):  # a zombie has no command line, but still its final CPU times
                self._records[key].state = dataclasses.replace(state, rss=0)
        rss = collections.Counter[str]()
        for key, record in self._records.items():
            record.ended = key not in sample
            if not record.ended:
                rss[record.kind] += record.state.rss
        self._peak_rss |= rss  # the maximum of each

    def usage(self) -> dict[str, Usage]:
        """Returns each kind's usage up to the last sample."""
        cpu, count = collections.defaultdict[str, float](float), collections.Counter[str]()
        for record in self._records.values():
            cpu[record.kind] += record.state.cpu
            count[record.kind] += 1
        cpu[self._short] += self._unseen_cpu()
        return {
            kind: Usage(seconds, self._peak_rss[kind], count[kind])
            for kind, seconds in sorted(cpu.items())
        }

    def _unseen_cpu(self) -> float:
        ended = collections.defaultdict[int, float](float)
        for record in self._records.values():
            if record.ended:
                ended[record.state.parent] += record.state.cpu + record.state.waited_cpu
        states = (record.state for record in self._records.values())
        return sum(max(0.0, state.waited_cpu - ended[state.pid]) for state in states)
