"""``pioneer_bench accuracy``: accuracy of the simulated robot's motion, contacts and laser."""

import argparse
import contextlib
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pioneer_bench.adapters.description import meshed_pioneer, pioneer_urdf
from pioneer_bench.core.accuracy import accuracy_rows, floor
from pioneer_bench.report import finish
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Model, World
from pioneer_gazebo.world.urdf import robot_from_urdf


class Worlds(contextlib.ExitStack):
    """Creates simulations with the node's settings; as a context manager it closes their engines on exit."""

    def make(self, models: list[Model]) -> Simulation:
        """Returns a simulation of the ground and ``models``."""
        engine = BulletEngine()
        self.callback(engine.close)
        simulation = Simulation(engine, triangles_of_mesh, Physics())
        simulation.load(World("trial", (floor(), *models)))
        return simulation


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
