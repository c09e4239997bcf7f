"""Runs one world of ``bench worlds`` in a separate process; prints its figures as JSON."""

import json
import math
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pioneer_bench.adapters.caster import distances, mesh_at
from pioneer_bench.adapters.description import pioneer_urdf
from pioneer_bench.adapters.made_world import loose_maze, shop
from pioneer_gazebo.error import ModelError
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Shape, World
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.resource import model_path
from pioneer_gazebo.world.robot import Robot
from pioneer_gazebo.world.sdf import world_from_sdf
from pioneer_gazebo.world.urdf import robot_from_urdf

SECONDS = 5
SCANS = 10
LONGEST_LOAD = 10.0
CLOSE = 0.02
"""A beam counts as true if it is this close to trimesh's [m]; sections have layers of 2 cm, and spheres have facets."""

MOST_WRONG = 0.01
"""Greatest share of beams that may be wrong: those that graze an edge."""


def main() -> int:
    """Loads, runs and checks the world of the setting given as JSON on the command line."""
    config = json.loads(sys.argv[1])
    robot = robot_from_urdf(pioneer_urdf(laser_noise=0))
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = (
            folder  # an empty cache, so that every run reduces the meshes
        )
        print(json.dumps(_figures(config["world"], config["robots"], robot, Path(folder))))
    return 0


MADE = {"285 loose boxes": lambda folder: loose_maze(), "97 mesh models": shop}


def _figures(name: str, robots: int, robot: Robot, folder: Path) -> dict[str, object]:
    made = MADE[name](folder) if name in MADE else None
    began = time.process_time()
    world = made or world_from_sdf(name, model_path())
    engine = BulletEngine()
    simulation = Simulation(engine, triangles_of_mesh, Physics(gravity=world.gravity))
    simulation.load(world)
    loaded = time.process_time() - began
    entities = _spawned(simulation, robot, robots)
    simulation.advance(2 * TICK_RATE)
    rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    errors = _errors(simulation, entities, world)
    factor = _factor(simulation, entities)
    return {
        "world": Path(name).stem,
        "robots": len(entities),
        "load": loaded,
        "rss": rss,
        "factor": factor,
        "beams": len(errors),
        "true": int((errors <= CLOSE).sum()),
        "worst": float(errors.max(initial=0.0, where=np.isfinite(errors))),
        "holds": loaded <= LONGEST_LOAD and factor >= 1.0 and are_true(errors),
    }


def are_true(errors: NDArray[np.float64]) -> bool:
    """Returns whether the beams with these range errors [m] are true, but for a few that graze an edge.

    No beam at all is no truth.
    """
    return errors.size > 0 and int((errors > CLOSE).sum()) <= MOST_WRONG * errors.size


def _spawned(simulation: Simulation, robot: Robot, robots: int) -> list[Entity]:
    """Spawns robots at free places of a grid, from the centre outwards."""
    places = sorted(
        ((x * 1.5, y * 1.5) for x in range(-8, 9) for y in range(-8, 9)),
        key=lambda p: math.hypot(*p),
    )
    simulation.spawn_search = 0.0
    entities: list[Entity] = []
    for x, y in places:
        if len(entities) == robots:
            break
        try:
            entities.append(
                simulation.add_robot(
                    f"r{len(entities)}", f"r{len(entities)}", robot, Pose((x, y, 0.0))
                )
            )
        except ModelError:
            continue  # occupied: try the next place
    return entities


def _errors(simulation: Simulation, robots: list[Entity], world: World) -> NDArray[np.float64]:
    """Returns the range errors [m] of all robots' beams; see `range_errors`."""
    standing = [(one.collision.shape, one.pose) for one in world.collisions(static_only=True)]
    loose = [
        shape
        for one in simulation.entities()
        if one not in robots
        for shape in _shapes(simulation, one)
    ]
    scenery: dict[float, trimesh.Trimesh] = {}
    errors = [np.empty(0)]
    for entity in robots:
        mounted = entity.lasers[0]
        config = mounted.laser.config
        ranges = simulation.ranges(entity, mounted).copy()
        sensor = simulation.pose(entity).compose(mounted.pose)
        angles = sensor.yaw + np.linspace(config.min_angle, config.max_angle, config.samples)
        beams = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
        height, eye = round(sensor.position[2], 4), np.array(sensor.position)
        if height not in scenery:
            scenery[height] = mesh_at(height, standing + loose)
        others = mesh_at(
            height,
            [one for other in robots if other is not entity for one in _shapes(simulation, other)],
        )
        truth = np.minimum(distances(scenery[height], eye, beams), distances(others, eye, beams))
        errors.append(range_errors(ranges, truth, config.min_range, config.max_range))
    return np.concatenate(errors)


def range_errors(
    ranges: NDArray[np.float64], truth: NDArray[np.float64], nearest: float, farthest: float
) -> NDArray[np.float64]:
    """Returns the errors of a scan's beams [m]; infinite for an echo that is missing or that nothing causes.

    Beams whose true range is within 0.1 m of a limit of the laser are left out: a rounding decides about their echo.

    Args:
        ranges: the scan [m]; infinite without an echo.
        truth: distance of what each beam hits [m]; infinite for nothing.
        nearest: the laser's minimum range [m].
        farthest: its maximum range [m].
    """
    seen = np.isfinite(ranges)
    visible = (truth > nearest + 0.1) & (truth < farthest - 0.1)
    invisible = truth > farthest + 0.1
    gaps = np.full(ranges.shape, np.inf)
    both = seen & np.isfinite(truth)
    gaps[both] = np.abs(ranges[both] - truth[both])
    return gaps[visible | (invisible & seen)]


def _shapes(simulation: Simulation, entity: Entity) -> list[tuple[Shape, Pose]]:
    """Returns the shapes of a moving model that lasers see, each with its current pose."""
    return [
        (touch.collision.shape, pose.compose(touch.collision.pose))
        for part, pose in zip(entity.body.parts, simulation.part_poses(entity), strict=True)
        for touch in part.touches
        if not touch.rolling
    ]


def _factor(simulation: Simulation, entities: list[Entity]) -> float:
    """Returns simulated seconds per CPU-second while all robots drive and scan."""
    for number, entity in enumerate(entities):
        entity.drives[0].command(simulation.moment, 0.3, 0.4 if number % 2 else -0.4)
    began = time.process_time()
    for _ in range(SECONDS * SCANS):
        simulation.advance(simulation.tick + TICK_RATE // SCANS)
        for entity in entities:
            simulation.ranges(entity, entity.lasers[0])
    return SECONDS / (time.process_time() - began)


if __name__ == "__main__":
    sys.exit(main())
