"""``./pioneer bench containers``: how long fleets take to drive, and what each computer of theirs needs."""

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from containers.engine import ContainerError
from containers.harness import Fleet, fleet

WINDOW = 30.0
"""For so long traffic and CPU time are counted [s]."""

BASE = "aadiworkstation"
COLUMNS: Mapping[str, str] = {
    "robots": "{:.0f}",
    "moving_s": "{:.0f}",
    "factor": "{:.2f}",
    "robot_mb": "{:.0f}",
    "base_mb": "{:.0f}",
    "robot_in_kb_s": "{:.0f}",
    "robot_out_kb_s": "{:.0f}",
    "cpu_s_a_sim_s": "{:.2f}",
}
"""By name of a figure, how it is written: seconds from `up` to all robots moving with all rules in force, real-time
factor, most memory of a robot's computer and that of the base station [MB], mean traffic of a robot's computer in and
out [kB/s], CPU time of all computers a simulated second."""


def measure(made: Fleet, robots: int, say: Callable[[str], None]) -> dict[str, float]:
    """Starts a fleet, and returns its figures by the names of `COLUMNS`."""
    said = made.pioneer("up", "--robots", str(robots), "--waypoints", "6")
    moving = re.search(r"^\d+ robots? drives? after (\d+) s", said, re.M)
    assert moving, said
    names = [f"aadi{number}" for number in range(1, robots + 1)]
    say(f"{robots} robots: all move after {moving[1]} s; counting for {WINDOW:g} s …")
    before, traffic, began = _state(made), [_traffic(made, name) for name in names], time.monotonic()
    time.sleep(WINDOW)
    after, passed = _state(made), time.monotonic() - began
    flows = [(_traffic(made, name), then) for name, then in zip(names, traffic, strict=True)]
    simulated = after[0] - before[0]
    inward, outward = (sum(now[way] - then[way] for now, then in flows) / robots / passed / 1e3 for way in (0, 1))
    return {
        "robots": robots,
        "moving_s": float(moving[1]),
        "factor": simulated / passed,
        "robot_mb": max(made.memory(name) for name in names) / 1e6,
        "base_mb": made.memory(BASE) / 1e6,
        "robot_in_kb_s": inward,
        "robot_out_kb_s": outward,
        "cpu_s_a_sim_s": (after[1] - before[1]) / simulated,
    }


def _state(made: Fleet) -> tuple[float, float]:
    """Returns simulated time and the CPU time of all computers [s]."""
    said = made.execute(BASE, "rosservice", "call", "/gazebo/get_world_properties")
    found = re.search(r"sim_time: (\S+)", said)
    assert found, said
    return float(found[1]), made.cpu_seconds()


def _traffic(made: Fleet, computer: str) -> tuple[int, int]:
    """Returns how many bytes came to a computer and left it."""
    words = re.search(r"eth0:(.*)", made.execute(computer, "cat", "/proc/net/dev"))
    assert words, "every computer is on the network"
    counts = words[1].split()
    return int(counts[0]), int(counts[8])


def table(rows: Sequence[Mapping[str, float]]) -> str:
    """Returns the figures as a Markdown table."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    return "\n".join([*lines, *map(_line, rows)])


def _line(row: Mapping[str, float]) -> str:
    return "| " + " | ".join(form.format(row[name]) for name, form in COLUMNS.items()) + " |"


def main(words: Sequence[str]) -> int:
    """Measures fleets of each size on the command line; returns the exit status."""
    parser = argparse.ArgumentParser("./pioneer bench containers", description=__doc__)
    parser.add_argument("robots", type=int, nargs="*", default=[5, 10, 15], metavar="N", help="default: 5 10 15")
    parser.add_argument("--output", type=Path, default=Path("bench-report"), metavar="DIR", help="default: %(default)s")
    options = parser.parse_args(words)
    options.output.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, float]] = []
    try:
        for robots in options.robots:
            with fleet("pioneer-scale", "10.88.6") as made:
                rows.append(measure(made, robots, lambda text: print(text, flush=True)))
            print(_line(rows[-1]), flush=True)
    except (ContainerError, AssertionError) as error:
        print(f"pioneer: {error}", file=sys.stderr)
        return 1
    finally:
        (options.output / "containers.json").write_text(json.dumps(rows, indent=1) + "\n")
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
