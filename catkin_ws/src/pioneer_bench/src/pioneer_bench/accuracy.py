"""``pioneer_bench accuracy``: how true the simulated robot's motion, contacts and laser are."""

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pioneer_bench.adapters.description import meshed_pioneer, pioneer_urdf
from pioneer_bench.adapters.world import Worlds
from pioneer_bench.core.accuracy import accuracy_rows
from pioneer_bench.core.row import table
from pioneer_bench.report import add_output, write
from pioneer_gazebo.adapters.urdf import robot_from_urdf


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    """Runs all trials; returns 0 where every bound holds, else 1."""
    with Worlds() as worlds, TemporaryDirectory() as folder:
        rows = list(accuracy_rows(worlds.make, robot_from_urdf(pioneer_urdf())))
        meshed = accuracy_rows(worlds.make, meshed_pioneer(Path(folder)))
        rows += [replace(row, what=f"mesh wheels: {row.what}") for row in meshed]
    write(options.output, "accuracy", "The simulator's accuracy", table(rows), [row.as_dict() for row in rows])
    return 0 if all(row.holds for row in rows) else 1
