"""Spawns bodies on the surface below them and clear of other bodies."""

import math
from collections.abc import Sequence
from dataclasses import replace

from pioneer_gazebo.body.body import Body, lowest_points
from pioneer_gazebo.physics.engine import Contact, Engine
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.section import Triangles

DEEPEST_START = 0.02
"""Maximum penetration [m] of a newly spawned model."""

GROUND_GAP = 0.0005
"""A body spawned in the ground is lifted to this height [m] above it."""

STEP_UP = 0.3
"""A body spawned at most this far [m] below the top of something is lifted onto it."""

SEARCH_STEP, DIRECTIONS = 0.05, 16
"""Spacing [m] of the rings searched for a free pose, and number of directions per ring."""


def added(
    engine: Engine, body: Body, pose: Pose, triangles: Triangles, anywhere: bool, search: float
) -> tuple[int, Pose] | Contact:
    """Adds a body to the engine; returns its handle and final pose, or its deepest contact if it would overlap.

    Args:
        engine: the engine.
        body: the body.
        pose: of its base.
        triangles: reads meshes.
        anywhere: whether it may overlap anything, as for the models of a world file.
        search: maximum shift to resolve an overlap with something static [m].
    """
    pose = _lifted(engine, body, pose, triangles, DEEPEST_START if anywhere else STEP_UP)
    handle = engine.add(body, pose)
    worst = None if anywhere else _deepest(engine.overlap(handle))
    if worst is None:
        return handle, pose
    # A pose slightly inside a wall is inaccurate and can be corrected; one inside another model is an error.
    found = _free_pose(engine, handle, pose, search) if worst.other is None else None
    if found is None:
        engine.remove(handle)
        return worst
    return handle, found


def _lifted(engine: Engine, body: Body, pose: Pose, triangles: Triangles, most: float) -> Pose:
    """Returns ``pose`` raised by at most ``most`` [m], so that the body stands on the surface it would penetrate."""
    points = lowest_points(body, pose, triangles)
    if not points or body.parts[0].mass <= 0:
        return pose
    lowest = min(z for _, _, z in points)
    support = engine.support([(x, y) for x, y, _ in points], lowest + most)
    if support is None or lowest >= support + GROUND_GAP:
        return pose
    x, y, z = pose.position
    return replace(pose, position=(x, y, z + support + GROUND_GAP - lowest))


def _free_pose(engine: Engine, handle: int, pose: Pose, bound: float) -> Pose | None:
    """Moves a body to the nearest pose without overlaps, at most ``bound`` [m] from ``pose`` in the plane.

    Returns:
        That pose; None if there is none, which leaves the body at the last pose tried.
    """
    x, y, z = pose.position
    for ring in range(1, round(bound / SEARCH_STEP) + 1):
        for number in range(DIRECTIONS):
            angle = math.tau * number / DIRECTIONS
            radius = ring * SEARCH_STEP
            tried = replace(
                pose, position=(x + radius * math.cos(angle), y + radius * math.sin(angle), z)
            )
            engine.set_pose(handle, tried)
            if _deepest(engine.overlap(handle)) is None:
                return tried
    return None


def _deepest(contacts: Sequence[Contact]) -> Contact | None:
    """Returns the deepest contact if it is too deep to spawn there, otherwise None."""
    worst = max(contacts, key=lambda contact: contact.depth, default=None)
    return worst if worst is not None and worst.depth > DEEPEST_START else None
