"""``pioneer_bench sim``: the simulator's cost by number of robots."""

import argparse
import dataclasses
import json
import subprocess
import sys
from pathlib import Path

from pioneer_bench.core.setting import SETTINGS, Rates
from pioneer_bench.core.simulator import Run, table

EXPLANATION = "`!` misses its goal; `ratio` is to the peer. CPU-s: all threads of the simulator's process."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--setting", nargs="+", choices=SETTINGS, default=list(SETTINGS), help="default: all")
    parser.add_argument("--robots", type=int, nargs="+", metavar="N", help="instead of the setting's numbers")
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated length of each window [s]")
    parser.add_argument("--beams", type=int, help="of a scan, instead of the setting's")
    parser.add_argument("--scan-rate", type=float, help="[Hz], instead of the setting's")
    parser.add_argument("--odometry-rate", type=float, help="of odom and tf [Hz], instead of the setting's")
    parser.add_argument("--real-time-factor", type=float, help="0: as fast as possible; instead of the setting's")
    parser.add_argument("--seed", type=int, default=1, help="of walls and noise")
    parser.add_argument("--output", type=Path, default=Path("bench-report"), metavar="DIR", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Runs each setting, one process for each number of robots; returns 0 where every goal holds, else 1."""
    measured: dict[str, list[Run]] = {}
    for name in options.setting:
        measured[name] = []
        rates = _rates(SETTINGS[name], options)
        for robots in rates.robots:
            print(f"{name}: {robots} robots, {options.seconds:g} simulated seconds …", flush=True)
            one = _one(robots, rates, options)
            if one is None:
                return 2
            measured[name].append(one)
    sections = [_section(_rates(SETTINGS[name], options), runs) for name, runs in measured.items()]
    text = "\n".join([*sections, EXPLANATION, ""])
    print("\n" + text)
    _write(options.output, text, measured)
    return 0 if all(holds for runs in measured.values() for one in runs for _, holds in one.goals().values()) else 1


def _rates(rates: Rates, options: argparse.Namespace) -> Rates:
    """Returns the setting with what the command line says otherwise."""
    names = ("robots", "beams", "scan_rate", "odometry_rate", "real_time_factor")
    asked = {name: getattr(options, name) for name in names}
    changes = {name: value for name, value in asked.items() if value is not None}
    if changes.keys() - {"robots"}:
        changes |= {"title": f"{rates.title}; changed: {changes}", "peers": {}, "peer": "", "goals": {}}
    return dataclasses.replace(rates, **changes)


def _section(rates: Rates, runs: list[Run]) -> str:
    peer = f"\nPeer: {rates.peer}.\n" if rates.peer else ""
    return f"## {rates.title}\n\n{table(runs, rates.peers)}\n{peer}"


def _write(folder: Path, text: str, measured: dict[str, list[Run]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "simulator.md").write_text(f"# The simulator\n\n{text}")
    values = {name: [one.as_dict() for one in runs] for name, runs in measured.items()}
    (folder / "simulator.json").write_text(json.dumps(values, indent=2) + "\n")
    print(f"written: {folder / 'simulator.md'}, {folder / 'simulator.json'}")


def _one(robots: int, rates: Rates, options: argparse.Namespace) -> Run | None:
    """Returns one run's figures, None (and a line) where it failed."""
    setting = {
        "robots": robots,
        "seconds": options.seconds,
        "beams": rates.beams,
        "scan_rate": rates.scan_rate,
        "odometry_rate": rates.odometry_rate,
        "other_rate": rates.other_rate,
        "clock_rate": rates.clock_rate,
        "real_time_factor": rates.real_time_factor,
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
    measured = Run(**{name: values[name] for name in Run.__dataclass_fields__})
    return dataclasses.replace(
        measured,
        asked_factor=rates.real_time_factor,
        cost_goal=rates.goals.get(robots),
        factor_goal=rates.least_factor,
    )
