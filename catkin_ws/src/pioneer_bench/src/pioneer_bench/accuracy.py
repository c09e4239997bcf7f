"""``pioneer_bench accuracy``: accuracy of the simulated robot's motion, contacts and laser."""

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pioneer_bench.adapters.description import meshed_pioneer, pioneer_urdf
from pioneer_bench.adapters.world import Worlds
from pioneer_bench.core.accuracy import accuracy_rows
from pioneer_bench.report import finish
from pioneer_gazebo.adapters.urdf import robot_from_urdf


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds nothing: this bench has no options of its own."""
    del parser


def run(options: argparse.Namespace) -> int:
    """Runs all trials; returns 0 if every bound holds, else 1."""
    with Worlds() as worlds, TemporaryDirectory() as folder:
        rows = list(accuracy_rows(worlds.make, robot_from_urdf(pioneer_urdf())))
        meshed = accuracy_rows(worlds.make, meshed_pioneer(Path(folder)))
        rows += [replace(row, what=f"mesh wheels: {row.what}") for row in meshed]
    return finish(options, "accuracy", "The simulator's accuracy", rows)
