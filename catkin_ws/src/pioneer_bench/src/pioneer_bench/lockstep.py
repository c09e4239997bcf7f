"""``pioneer_bench lockstep``: speed and cost of demos in which simulated time waits for every robot's nodes."""

import argparse
import json
import subprocess
import sys
from typing import Any

from pioneer_bench.core.row import Row
from pioneer_bench.report import finish

FACTOR_OF_TWO = 3.0
"""Least real-time factor with two robots on two idle cores."""
STALE = "out of date"
"""What move_base logs when a costmap did not get a scan in time."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument(
        "--robots", type=int, nargs="+", metavar="N", default=[2, 5, 15], help="default: 2 5 15"
    )
    parser.add_argument("--world", default="utm_0", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="default: %(default)s")
    parser.add_argument(
        "--waypoints", type=int, default=1, metavar="K", help="of each robot (default %(default)s)"
    )
    parser.add_argument(
        "--repeat", type=int, default=2, metavar="K", help="runs of each size (default %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Runs all demos; returns 0 if every goal is met, 1 if one is missed, 2 if a demo failed."""
    rows, values, complete = list[Row](), list[dict[str, Any]](), True
    for robots in options.robots:
        runs = [_demo(robots, number, options) for number in range(options.repeat)]
        driven = [one for one in runs if one is not None]
        complete &= len(driven) == len(runs)
        rows += _rows(robots, driven)
        values += [
            {name: value for name, value in one.items() if name != "bytes"} for one in driven
        ]
    remark = f"{options.world}, seed {options.seed}, {options.waypoints} waypoints a robot. "
    remark += "A sample is a demo; equal are all files of all demos of a size."
    status = finish(options, "lockstep", "Lockstep", rows, remark, runs=values)
    return status if complete else 2


def _rows(robots: int, runs: list[dict[str, Any]]) -> list[Row]:
    def samples(name: str) -> tuple[float, ...]:
        return tuple(float(one[name]) for one in runs)

    name = f"{robots} robots"
    goal = FACTOR_OF_TWO if robots == 2 else None
    rows = [
        Row(f"{name}: real-time factor", "", samples("real_time_factor"), goal, at_least=True),
        Row(f"{name}: CPU a simulated second", "s", samples("cpu_seconds_per_simulated_second")),
        Row(f"{name}: waypoints missed", "", samples("missed"), 0.0, every=True),
        Row(f"{name}: complaints of stale sensor data", "", samples("stale"), 0.0, every=True),
    ]
    if len(runs) > 1:
        kinds = float(len({one["bytes"] for one in runs}))
        rows.append(Row(f"{name}: different results of one seed", "", (kinds,), 1.0))
    return rows


def _demo(robots: int, number: int, options: argparse.Namespace) -> dict[str, Any] | None:
    """Returns the report of one demo; prints a line and returns None if there is none."""
    folder = (options.output / f"lockstep-{robots}-{number}").absolute()
    words = {
        "robots": robots,
        "world": options.world,
        "seed": options.seed,
        "waypoints": options.waypoints,
    }
    command = [sys.executable, "-m", "pioneer_demo", "demo", "--lockstep", "--report", str(folder)]
    command += [word for name, value in words.items() for word in (f"--{name}", str(value))]
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "output.txt").open("w") as output:
        status = subprocess.run(
            command, stdout=output, stderr=subprocess.STDOUT, check=False
        ).returncode
    machine = folder / "machine.json"
    if not machine.is_file() or status not in (0, 1):
        print(
            f"{robots} robots: no report, exit status {status}; see {folder / 'output.txt'}",
            flush=True,
        )
        return None
    report, drive = (
        json.loads((folder / "report.json").read_text()),
        json.loads(machine.read_text())["drive"],
    )
    logs = [path for path in (folder / "log").rglob("*.log") if path.is_file()]
    stale = sum(path.read_text(errors="replace").count(STALE) for path in logs)
    visits = [robot["waypoints"] - robot["reached"] for robot in report["robots"].values()]
    found = {
        "robots": robots,
        **drive,
        "missed": sum(visits),
        "stale": stale,
        "faults": report["faults"],
    }
    print(
        f"{robots} robots: factor {drive['real_time_factor']:.2f}, {found['missed']} waypoints missed",
        flush=True,
    )
    files = ("ground_truth.csv", "commands.csv", "report.json")
    return {**found, "bytes": b"".join((folder / name).read_bytes() for name in files)}
