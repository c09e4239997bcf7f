"""``./pioneer bench containers``: how long fleets take to drive, and what each computer of theirs needs."""

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from containers.engine import ContainerError
from containers.harness import CPU_SCRIPT, Fleet, cpu_of, fleet

WINDOW = 30.0
"""For so long traffic and CPU time are counted [s]."""

BASE = "aadiworkstation"
FIGURES: Mapping[str, tuple[str, str, Mapping[int, float]]] = {
    "moving_s": ("`up` to all moving, all rules in force", "s", {5: 15.0, 15: 45.0}),
    "factor": ("real-time factor", "", {15: -0.9}),
    "cpu_s_a_sim_s": ("all computers", "CPU-s/sim-s", {15: 2.2}),
    "robot_cpu": ("a robot's computer, mean", "CPU-s/sim-s", {0: 0.12}),
    "robot_mb": ("a robot's computer, the most", "MB", {0: 180.0}),
    "base_mb": ("base station", "MB", {15: 350.0}),
    "robot_in_kb": ("into a robot's computer", "kB/sim-s", {15: 40.0}),
    "robot_out_kb": ("out of a robot's computer", "kB/sim-s", {}),
    "growth": ("CPU of the largest fleet / of as many robots at the smallest's cost", "", {15: 1.05}),
}
"""By name of a figure: what it is, its unit, its goal by number of robots, 0 for any; a negative one is the least."""

_NOW = """
import rospy, time
from rosgraph_msgs.msg import Clock
rospy.init_node("bench", anonymous=True, disable_rostime=True)
print(rospy.wait_for_message("/clock", Clock).clock.to_sec(), time.monotonic())
"""
"""Prints simulated time and the kernel's, both at the moment at which a message on /clock arrives [s]."""


def measure(made: Fleet, robots: int, say: Callable[[str], None]) -> dict[str, float]:
    """Starts a fleet, and returns its figures by the names of `FIGURES`, and ``robots``."""
    said = made.pioneer("up", "--robots", str(robots), "--waypoints", "6")
    moving = re.search(r"^\d+ robots? drives? after (\d+) s", said, re.M)
    assert moving, said
    names = [BASE, *(f"aadi{number}" for number in range(1, robots + 1))]
    say(f"{robots} robots: all move after {moving[1]} s; counting for {WINDOW:g} s …")
    began, before = _now(made), [_counts(made, name) for name in names]
    time.sleep(WINDOW)
    ended, after = _now(made), [_counts(made, name) for name in names]
    factor = (ended[0] - began[0]) / (ended[1] - began[1])
    base, *own = [_rates(first, last, factor) for first, last in zip(before, after, strict=True)]
    mean = [sum(one[column] for one in own) / robots for column in range(3)]
    return {
        "robots": robots,
        "moving_s": float(moving[1]),
        "factor": factor,
        "cpu_s_a_sim_s": base[0] + robots * mean[0],
        "robot_cpu": mean[0],
        "robot_mb": max(made.memory(name) for name in names[1:]) / 1e6,
        "base_mb": made.memory(BASE) / 1e6,
        "robot_in_kb": mean[1] / 1e3,
        "robot_out_kb": mean[2] / 1e3,
    }


def _now(made: Fleet) -> tuple[float, float]:
    """Returns simulated and wall time [s] of one moment, however long the command takes that asks."""
    simulated, wall = made.execute(BASE, "python3", "-c", _NOW).split()
    return float(simulated), float(wall)


def _counts(made: Fleet, computer: str) -> tuple[float, ...]:
    """Returns wall time [s], CPU time [s], and bytes that came to a computer and left it, of one moment."""
    text = made.execute(computer, "sh", "-c", f"cat /proc/uptime /proc/net/dev; {CPU_SCRIPT}")
    words = re.search(r"eth0:(.*)", text)
    assert words, "every computer is on the network"
    counts = words[1].split()
    return float(text.split()[0]), cpu_of(text), float(counts[0]), float(counts[8])


def _rates(first: Sequence[float], last: Sequence[float], factor: float) -> list[float]:
    """Returns CPU time [s] and bytes in and out a simulated second; each computer was asked at its own moments."""
    seconds = (last[0] - first[0]) * factor
    return [(now - then) / seconds for then, now in zip(first[1:], last[1:], strict=True)]


def with_growth(rows: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """Returns the rows, the last of several with the growth since the first."""
    found = [dict(row) for row in rows]
    if len(found) > 1:
        cost = [row["cpu_s_a_sim_s"] / row["robots"] for row in (found[0], found[-1])]
        found[-1]["growth"] = cost[1] / cost[0]
    return found


def table(rows: Sequence[Mapping[str, float]]) -> str:
    """Returns the figures as a Markdown table, each with its goal and whether it holds."""
    lines = ["| robots | what | measured | unit | goal | holds |", "|---|---|---|---|---|---|"]
    return "\n".join([*lines, *(_line(row, name) for row in with_growth(rows) for name in row if name in FIGURES)])


def _line(row: Mapping[str, float], name: str) -> str:
    what, unit, goals = FIGURES[name]
    value, goal = row[name], goals.get(0, goals.get(int(row["robots"])))
    words, holds = "", ""
    if goal is not None:
        words = f"≤ {goal:g}" if goal > 0 else f"≥ {-goal:g}"
        holds = "yes" if (value <= goal if goal > 0 else value >= -goal) else "no"
    return f"| {row['robots']:g} | {what} | {value:.3g} | {unit} | {words} | {holds} |"


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
            print(table(rows[-1:]), flush=True)
    except (ContainerError, AssertionError) as error:
        print(f"pioneer: {error}", file=sys.stderr)
        return 1
    finally:
        (options.output / "containers.json").write_text(json.dumps(rows, indent=1) + "\n")
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
