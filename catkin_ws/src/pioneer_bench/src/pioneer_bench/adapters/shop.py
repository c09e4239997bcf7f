"""A shop full of meshes, like public shop worlds: 97 models with 254 collisions of 20,480 triangles each."""

import random
from pathlib import Path

import numpy as np
import trimesh

from pioneer_bench.core.accuracy import floor
from pioneer_gazebo.core.pose import IDENTITY, Pose
from pioneer_gazebo.core.world import Collision, Inertia, Link, Mesh, Model, World

MODELS, COLLISIONS, FILES = 97, 254, 12
PITCH, COLUMNS = 2.2, 10
"""Distance between models [m], and models a row. A third of the models are movable: crates, which stand upright."""

FOOT = 0.3
"""Depth below its centre at which a mesh is cut flat [m]."""


def shop(folder: Path) -> World:
    """Returns the shop, always the same one; writes its meshes to ``folder``."""
    chance = random.Random(1)
    lumps = [_lump(folder / f"{number}.stl", number) for number in range(FILES)]
    crate = trimesh.creation.box((0.8, 0.8, 2 * FOOT))
    for _ in range(5):
        crate = crate.subdivide()
    crate.export(folder / "crate.stl")
    models = [floor()]
    for number in range(MODELS):
        row, column = divmod(number, COLUMNS)
        count = COLLISIONS // MODELS + (number < COLLISIONS % MODELS)
        files = lumps if number % 3 else [str(folder / "crate.stl")]
        shapes = tuple(
            Collision(f"c{k}", Pose((0.0, 0.0, FOOT + 0.6 * k)), Mesh(chance.choice(files))) for k in range(count)
        )
        pose = Pose(((column - COLUMNS / 2) * PITCH, (row - COLUMNS / 2) * PITCH, 0.0))
        link = Link("link", IDENTITY, 20.0, Inertia(), shapes)
        models.append(Model(f"model_{number}", pose, number % 3 > 0, (link,)))
    return World(f"{MODELS} mesh models", tuple(models))


def _lump(path: Path, seed: int) -> str:
    """Writes a lumpy ball 1 m in diameter with a flat foot; returns the file's path."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    waves = np.random.default_rng(seed).uniform(2.0, 6.0, 3)
    points = ball.vertices * (0.8 + 0.2 * np.sin(ball.vertices @ np.diag(waves) * 3.0).mean(axis=1, keepdims=True))
    points[:, 2] = np.maximum(points[:, 2], -FOOT)
    ball.vertices = points
    ball.export(path)
    return str(path)
