"""CPU time and memory of the programs of one ROS master on this machine, read from ``/proc``."""

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

_TICK = os.sysconf("SC_CLK_TCK")
_MASTER = b"ROS_MASTER_URI="


@dataclass(frozen=True)
class Load:
    """CPU and memory use of programs."""

    processors: float  #: average CPU time since the last look [s/s]
    memory: int  #: proportional set size: shared pages count by their share [byte]


class ProgramLoad:
    """Measures the programs that were started for one master: on a robot's computer, those of the robot.

    Args:
        uri: URI of the master; its port distinguishes the masters on one machine.
        root: the proc file system.
    """

    def __init__(self, uri: str, root: Path = Path("/proc")) -> None:
        self._port, self._root = urlsplit(uri).port, root
        self._belongs: dict[str, bool] = {}
        self._spent: dict[str, float] = {}
        self._at = 0.0

    def look(self, now: float) -> Load:
        """Returns the load since the last look, with no CPU time at the first; ``now`` is monotonic [s]."""
        there = [name for name in os.listdir(self._root) if name.isdigit()]
        known = self._belongs
        self._belongs = {
            name: known[name] if name in known else self._is_of_master(name) for name in there
        }
        spent, memory = dict[str, float](), 0
        for name in (one for one in there if self._belongs[one]):
            # A process that ends meanwhile is not counted.
            with contextlib.suppress(OSError):
                spent[name] = self._processor_time(name)
                memory += self._memory(name)
        used = sum(time - self._spent.get(name, 0.0) for name, time in spent.items())
        busy = max(0.0, used) / (now - self._at) if self._spent else 0.0
        self._spent, self._at = spent, now
        return Load(busy, memory)

    def _is_of_master(self, name: str) -> bool:
        with contextlib.suppress(OSError):
            for line in (self._root / name / "environ").read_bytes().split(b"\0"):
                if line.startswith(_MASTER):
                    return _port(line[len(_MASTER) :].decode(errors="replace")) == self._port
        return False

    def _processor_time(self, name: str) -> float:
        # The second field, a name in parentheses, may contain any characters.
        fields = (self._root / name / "stat").read_text(errors="replace").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICK

    def _memory(self, name: str) -> int:
        for line in (self._root / name / "smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
        return 0


def _port(uri: str) -> int | None:
    try:
        return urlsplit(uri).port
    except ValueError:  # any process may have an invalid URI in its environment
        return None
