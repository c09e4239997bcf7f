"""``pioneer_bench sim``: the simulator's cost by number of robots."""

import argparse
import dataclasses

from pioneer_bench.core.simulator import SETTINGS, Rates, Run, table
from pioneer_bench.report import measured, write

EXPLANATION = (
    "`!` misses its goal; `ratio` is to the peer. CPU-s: all threads of the simulator's process."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument(
        "--setting", nargs="+", choices=SETTINGS, default=list(SETTINGS), help="default: all"
    )
    parser.add_argument(
        "--robots", type=int, nargs="+", metavar="N", help="instead of the setting's numbers"
    )
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="simulated length of each window [s]"
    )
    parser.add_argument("--beams", type=int, help="of a scan, instead of the setting's")
    parser.add_argument("--scan-rate", type=float, help="[Hz], instead of the setting's")
    parser.add_argument(
        "--odometry-rate", type=float, help="of odom and tf [Hz], instead of the setting's"
    )
    parser.add_argument(
        "--real-time-factor", type=float, help="0: as fast as possible; instead of the setting's"
    )
    parser.add_argument("--seed", type=int, default=1, help="of walls and noise")


def run(options: argparse.Namespace) -> int:
    """Runs each setting with one process per number of robots; returns 0 if every goal is met, else 1."""
    found: dict[str, list[Run]] = {}
    sections = []
    for name in dict.fromkeys(options.setting):
        found[name] = []
        rates = _rates(SETTINGS[name], options)
        for robots in rates.robots:
            print(f"{name}: {robots} robots, {options.seconds:g} simulated seconds …", flush=True)
            one = _one(robots, rates, options)
            if one is None:
                return 2
            found[name].append(one)
        peer = f"\nPeer: {rates.peer}.\n" if rates.peer else ""
        sections.append(f"## {rates.title}\n\n{table(found[name], rates.peers)}\n{peer}")
    values = {name: [one.as_dict() for one in runs] for name, runs in found.items()}
    write(options.output, "simulator", "The simulator", "\n".join([*sections, EXPLANATION]), values)
    return (
        0
        if all(
            holds for runs in found.values() for one in runs for _, holds in one.goals().values()
        )
        else 1
    )


def _rates(rates: Rates, options: argparse.Namespace) -> Rates:
    """Returns the setting with the command line's changes."""
    names = ("robots", "beams", "scan_rate", "odometry_rate", "real_time_factor")
    asked = {name: getattr(options, name) for name in names}
    changes = {name: value for name, value in asked.items() if value is not None}
    if changes.keys() - {"robots"}:
        changes |= {
            "title": f"{rates.title}; changed: {changes}",
            "peers": {},
            "peer": "",
            "goals": {},
        }
    return dataclasses.replace(rates, **changes)


def _one(robots: int, rates: Rates, options: argparse.Namespace) -> Run | None:
    """Returns the results of one run; prints a line and returns None if it failed."""
    setting = {"robots": robots, "seconds": options.seconds, "seed": options.seed}
    values = measured("load", {**setting, "rates": dataclasses.asdict(rates)})
    if values is None:
        print(f"the run with {robots} robots failed")
        return None
    return Run(
        **values,
        asked_factor=rates.real_time_factor,
        cost_goal=rates.goals.get(robots),
        factor_goal=rates.least_factor,
    )
