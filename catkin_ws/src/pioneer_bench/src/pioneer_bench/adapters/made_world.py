"""Worlds that are made for the bench: a maze of loose boxes, and a shop full of meshes."""

import random
from pathlib import Path

import numpy as np
import trimesh

from pioneer_bench.core.accuracy import floor
from pioneer_gazebo.world.model import Box, Collision, Inertia, Link, Mesh, Model, World
from pioneer_gazebo.world.pose import IDENTITY, Pose

BOXES, BOX_COLUMNS = 285, 19
BOX_PITCH = 1.4
LENGTH, WIDTH, HEIGHT = 1.0, 0.15, 1.0
"""Size of a box [m]."""

MODELS, COLLISIONS, FILES = 97, 254, 12
"""Of the shop; each collision has 20,480 triangles, as in public shop worlds."""
PITCH, COLUMNS = 2.2, 10
"""Distance between models [m], and models a row. A third of the models are movable: crates, which stand upright."""

FOOT = 0.3
"""Depth below its centre at which a mesh is cut flat [m]."""


def loose_maze() -> World:
    """Returns a maze, always the same one, of loose boxes, as in worlds whose author forgot ``<static>``."""
    chance = random.Random(1)
    boxes = []
    for number in range(BOXES):
        row, column = divmod(number, BOX_COLUMNS)
        size = (LENGTH, WIDTH, HEIGHT) if chance.random() < 0.5 else (WIDTH, LENGTH, HEIGHT)
        link = Link(
            "link", mass=10.0, inertia=Inertia(), collisions=(Collision("c", Pose(), Box(size)),)
        )
        pose = Pose(
            (
                (column - BOX_COLUMNS / 2) * BOX_PITCH,
                (row - BOXES / BOX_COLUMNS / 2) * BOX_PITCH,
                HEIGHT / 2,
            )
        )
        boxes.append(Model(f"box_{number}", pose, links=(link,)))
    return World("285 loose boxes", (floor(), *boxes))


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
            Collision(f"c{k}", Pose((0.0, 0.0, FOOT + 0.6 * k)), Mesh(chance.choice(files)))
            for k in range(count)
        )
        pose = Pose(((column - COLUMNS / 2) * PITCH, (row - COLUMNS / 2) * PITCH, 0.0))
        link = Link("link", IDENTITY, 20.0, Inertia(), shapes)
        models.append(Model(f"model_{number}", pose, number % 3 > 0, (link,)))
    return World(f"{MODELS} mesh models", tuple(models))


def _lump(path: Path, seed: int) -> str:
    """Writes a lumpy ball 1 m in diameter with a flat foot; returns the file's path."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    waves = np.random.default_rng(seed).uniform(2.0, 6.0, 3)
    points = ball.vertices * (
        0.8 + 0.2 * np.sin(ball.vertices @ np.diag(waves) * 3.0).mean(axis=1, keepdims=True)
    )
    points[:, 2] = np.maximum(points[:, 2], -FOOT)
    ball.vertices = points
    ball.export(path)
    return str(path)
