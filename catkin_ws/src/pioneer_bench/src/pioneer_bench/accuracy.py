"""``pioneer_bench accuracy``: how true the simulated robot's motion, contacts and laser are."""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pioneer_bench.adapters.description import meshed_pioneer, pioneer_urdf
from pioneer_bench.adapters.world import Worlds
from pioneer_bench.core.accuracy import accuracy_rows
from pioneer_bench.core.row import table
from pioneer_gazebo.adapters.urdf import robot_from_urdf


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--output", type=Path, default=Path("bench-report"), metavar="DIR", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Runs all trials; returns 0 where every bound holds, else 1."""
    with Worlds() as worlds, TemporaryDirectory() as folder:
        rows = list(accuracy_rows(worlds.make, robot_from_urdf(pioneer_urdf())))
        meshed = accuracy_rows(worlds.make, meshed_pioneer(Path(folder)))
        rows += [replace(row, what=f"mesh wheels: {row.what}") for row in meshed]
    text = table(rows)
    print(text)
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "accuracy.md").write_text(f"# The simulator's accuracy\n\n{text}\n")
    (options.output / "accuracy.json").write_text(json.dumps([row.as_dict() for row in rows], indent=2) + "\n")
    return 0 if all(row.holds for row in rows) else 1
