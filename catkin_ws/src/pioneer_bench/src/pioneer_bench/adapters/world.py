"""Worlds on the real engine, without ROS."""

import contextlib

from pioneer_bench.core.accuracy import floor
from pioneer_gazebo.adapters.bullet import BulletEngine
from pioneer_gazebo.adapters.mesh import triangles_of_mesh
from pioneer_gazebo.core.engine import Physics
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.core.world import Model, World


class Worlds(contextlib.ExitStack):
    """Creates simulations with the node's settings; as a context manager it closes their engines on exit."""

    def make(self, models: list[Model]) -> Simulation:
        """Returns a simulation of the ground and ``models``."""
        engine = BulletEngine()
        self.callback(engine.close)
        simulation = Simulation(engine, triangles_of_mesh, Physics())
        simulation.load(World("trial", (floor(), *models)))
        return simulation
