"""``./pioneer bench containers``: how long fleets take to drive, and what each computer of theirs needs."""

import argparse
import contextlib
import json
import os
import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from containers.engine import ContainerError, output, say
from containers.harness import CPU_SCRIPT, END, Fleet, cpu_of, started
from containers.hosts import swarm_here
from pioneer_demo.scenario.option import factor_held
from pioneer_harness.proc import processors

WINDOW = 30.0
"""Time during which traffic and CPU time are counted [s]."""

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
    "trip_ms": (
        "round trip between gateways, base station's and a robot's, one machine, mean",
        "ms",
        {},
    ),
    "far_trip_ms": ("the same, on two machines", "ms", {}),
    "growth": (
        "CPU of the largest fleet / of as many robots at the smallest's cost",
        "",
        {15: 1.05},
    ),
}
"""By name of a figure: description, unit, and goal by number of robots (0: any); a negative goal is a lower bound."""

_NOW = f"""
import rospy, sys, time
from rosgraph_msgs.msg import Clock
rospy.init_node("bench", anonymous=True, disable_rostime=True)
for _ in sys.stdin:
    print(rospy.wait_for_message("/clock", Clock).clock.to_sec(), time.monotonic())
    print("{END}", flush=True)
"""
"""On request, prints simulated time and the kernel's time when the next message on /clock arrives [s]."""

_COUNTS = f"while read -r _; do cat /proc/uptime /proc/net/dev; {CPU_SCRIPT}; echo {END}; done"
"""On request, prints a computer's time, traffic and CPU time."""

_TRIPS = """
import json, rospy
from gateway_msgs.srv import RemoteGatewayInfo
found = rospy.ServiceProxy("/gateway/remote_gateway_info", RemoteGatewayInfo)([]).gateways
print(json.dumps({one.name: one.conn_stats.ping_latency_avg for one in found}))
"""
"""Prints the latest round trips [ms] by gateway; they queue on the link behind the messages that it carries."""


def measure(made: Fleet, robots: int, *options: str) -> dict[str, float]:
    """Starts a fleet with ``up`` and these options; returns its figures by the names of `FIGURES`, and ``robots``."""
    said = made.pioneer("up", "--robots", str(robots), "--waypoints", "6", *options)
    moving = re.search(r"^\d+ robots? drives? after (\d+) s", said, re.M)
    assert moving, said
    names = [BASE, *(f"aadi{number}" for number in range(1, robots + 1))]
    say(f"{robots} robots: all move after {moving[1]} s; counting for {WINDOW:g} s …")
    with contextlib.ExitStack() as stack:
        # Started before the measurement: starting a command on each computer would slow the world down.
        clock = stack.enter_context(made.asked(BASE, "python3", "-c", _NOW))
        counters = [stack.enter_context(made.asked(name, "sh", "-c", _COUNTS)) for name in names]
        for ask in (clock, *counters):
            ask()
        began, before = clock().split(), [_counts(ask()) for ask in counters]
        time.sleep(WINDOW)
        ended, after = clock().split(), [_counts(ask()) for ask in counters]
    simulated, wall = (float(last) - float(first) for first, last in zip(began, ended, strict=True))
    factor = simulated / wall
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
        **_trips(made),
    }


def _trips(made: Fleet) -> dict[str, float]:
    """Returns the mean round trip [ms] to robots' gateways on the base station's machine, and on others."""
    there = made.computers()
    trips: Mapping[str, float] = json.loads(made.execute(BASE, "python3", "-c", _TRIPS))
    near, far = list[float](), list[float]()
    for name, one in there.items():
        if one.robot and (trip := trips.get(f"{name}_gateway")):
            (near if one.node == there[BASE].node else far).append(trip)
    return {
        name: sum(some) / len(some)
        for name, some in (("trip_ms", near), ("far_trip_ms", far))
        if some
    }


def _counts(said: str) -> tuple[float, ...]:
    """Returns wall time [s], CPU time [s], and bytes received and sent, from an answer of `_COUNTS`."""
    words = re.search(r"eth0:(.*)", said)
    assert words, "every computer is on the network"
    counts = words[1].split()
    return float(said.split()[0]), cpu_of(said), float(counts[0]), float(counts[8])


def _rates(first: Sequence[float], last: Sequence[float], factor: float) -> list[float]:
    """Returns CPU time [s] and bytes in and out a simulated second; each computer is sampled at its own times."""
    seconds = (last[0] - first[0]) * factor
    return [(now - then) / seconds for then, now in zip(first[1:], last[1:], strict=True)]


def with_growth(rows: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """Returns the rows; if there are several, adds the growth since the first one to the last."""
    found = [dict(row) for row in rows]
    if len(found) > 1:
        cost = [row["cpu_s_a_sim_s"] / row["robots"] for row in (found[0], found[-1])]
        found[-1]["growth"] = cost[1] / cost[0]
    return found


def table(rows: Sequence[Mapping[str, float]]) -> str:
    """Returns the figures as a Markdown table, each, as printed, with its goal and whether that is met."""
    lines = ["| robots | what | measured | unit | goal | holds |", "|---|---|---|---|---|---|"]
    return "\n".join(
        [
            *lines,
            *(_line(row, name) for row in with_growth(rows) for name in row if name in FIGURES),
        ]
    )


def _line(row: Mapping[str, float], name: str) -> str:
    what, unit, goals = FIGURES[name]
    value, goal = float(f"{row[name]:.3g}"), goals.get(0, goals.get(int(row["robots"])))
    words, holds = "", ""
    if goal is not None:
        words = f"≤ {goal:g}" if goal > 0 else f"≥ {-goal:g}"
        holds = "yes" if (value <= goal if goal > 0 else value >= -goal) else "no"
    return f"| {row['robots']:g} | {what} | {value:g} | {unit} | {words} | {holds} |"


def comparison(compose: Mapping[str, float], swarm: Mapping[str, float]) -> str:
    """Returns the figures of two fleets with the same number of robots as a Markdown table."""
    lines = [f"| {compose['robots']:g} robots | unit | compose | swarm |", "|---|---|---|---|"]
    names = [name for name in FIGURES if name in compose or name in swarm]
    cells = [
        [f"{row[name]:.3g}" if name in row else "" for row in (compose, swarm)] for name in names
    ]
    rows = [
        "| " + " | ".join((*FIGURES[name][:2], *pair)) + " |"
        for name, pair in zip(names, cells, strict=True)
    ]
    return "\n".join([*lines, *rows])


@contextlib.contextmanager
def _some_swarm() -> Iterator[bool]:
    """Provides the swarm that this machine manages, else one of three engines here; yields whether it is the latter."""
    if json.loads(output("docker", "info", "-f", "{{json .Swarm.ControlAvailable}}")):
        yield False
        return
    say("this machine manages no swarm: starting two further engines on it")
    with swarm_here(2) as hosts:
        for host in hosts:
            host.join()
        yield True


def compare(robots: int) -> list[dict[str, float]]:
    """Measures a fleet on this machine, then one on the swarm; at the same speed if the swarm is local.

    Raises:
        ContainerError: there is no swarm and none can be made.
    """
    with _some_swarm() as here:
        # Each engine of a local swarm sees all processors of this machine.
        speed = ["--rtf", f"{factor_held(robots, processors()):g}"] if here else []
        rows = []
        for options in (speed, [*speed, "--swarm"]):
            with started(Fleet("pioneer-scale", "10.88.6")) as made:
                rows.append(measure(made, robots, *options))
            say(f"load {os.getloadavg()[0]:.1f}")
        return rows


def main(words: Sequence[str]) -> int:
    """Measures fleets of each size on the command line; returns the exit status."""
    parser = argparse.ArgumentParser("./pioneer bench containers", description=__doc__)
    parser.add_argument(
        "robots", type=int, nargs="*", metavar="N", help="default: 5 10 15; with --swarm 6"
    )
    parser.add_argument("--swarm", action="store_true", help="a fleet on this machine beside one on the swarm that it "
        "manages; without one, on three engines on this machine, as root")  # fmt: skip
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("bench-report"),
        metavar="DIR",
        help="default: %(default)s",
    )
    options = parser.parse_args(words)
    options.output.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, float]] = []

    try:
        for robots in options.robots or ([6] if options.swarm else [5, 10, 15]):
            if options.swarm:
                rows += compare(robots)
                say(comparison(*rows[-2:]))
                continue
            with started(Fleet("pioneer-scale", "10.88.6")) as made:
                rows.append(measure(made, robots))
            say(table(rows[-1:]))
    except (ContainerError, AssertionError) as error:
        print(f"pioneer: {error}", file=sys.stderr)
        return 1
    finally:
        (options.output / "containers.json").write_text(json.dumps(rows, indent=1) + "\n")
    if not options.swarm:
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
