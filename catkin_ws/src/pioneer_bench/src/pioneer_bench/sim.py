"""``pioneer_bench sim``: the simulator's cost by number of robots."""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from pioneer_bench.core.simulator import Run, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 5, 20], metavar="N", help="default: %(default)s")
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated length of each window [s]")
    parser.add_argument("--beams", type=int, default=180, help="of a scan")
    parser.add_argument("--scan-rate", type=float, default=10.0, help="[Hz]")
    parser.add_argument("--odometry-rate", type=float, default=50.0, help="of odom and tf [Hz]")
    parser.add_argument("--real-time-factor", type=float, default=1.0, help="0: as fast as possible")
    parser.add_argument("--seed", type=int, default=1, help="of walls and noise")
    parser.add_argument("--output", type=Path, default=None, metavar="FILE", help="where the figures go as JSON")


def run(options: argparse.Namespace) -> int:
    """Runs one process for each number of robots; returns 0 where every goal holds, else 1."""
    runs = []
    for robots in options.robots:
        print(f"{robots} robots, {options.seconds:g} simulated seconds …", flush=True)
        measured = _one(robots, options)
        if measured is None:
            return 2
        runs.append(measured)
    print("\n" + table(runs) + "\n! misses its goal. Gazebo: its cost at 1 ms steps with no publishing at all.")
    if options.output is not None:
        options.output.write_text(json.dumps([one.as_dict() for one in runs], indent=2) + "\n")
        print(f"written: {options.output}")
    return 0 if all(holds for one in runs for _, holds in one.goals().values()) else 1


def _one(robots: int, options: argparse.Namespace) -> Run | None:
    """Returns one run's figures, None (and a line) where it failed."""
    setting = {
        "robots": robots,
        "seconds": options.seconds,
        "beams": options.beams,
        "scan_rate": options.scan_rate,
        "odometry_rate": options.odometry_rate,
        "real_time_factor": options.real_time_factor,
        "seed": options.seed,
    }
    # A process of its own: a process can be only one ROS node, on one master.
    command = [sys.executable, "-m", "pioneer_bench.nodes.load", json.dumps(setting)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        print(f"the run with {robots} robots failed, status {done.returncode}", file=sys.stderr)
        return None
    values = json.loads(lines[-1])
    return Run(**{name: values[name] for name in Run.__dataclass_fields__})
