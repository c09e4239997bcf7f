"""Where a model may be added: on what is below it, and clear of everything else."""

import math
from collections.abc import Sequence
from dataclasses import replace

from pioneer_gazebo.core.body import Body, lowest_points
from pioneer_gazebo.core.engine import Contact, Engine
from pioneer_gazebo.core.error import ModelError
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.section import Triangles

DEEPEST_START = 0.02
"""A model may be spawned at most this far [m] inside something else."""

GROUND_GAP = 0.0005
"""What is spawned in the ground is lifted until it is this far [m] above."""

STEP_UP = 0.3
"""What is spawned at most this far [m] below the top of something is lifted on to it."""

SEARCH_STEP, DIRECTIONS = 0.05, 16
"""A free pose is looked for in rings that are this far [m] apart, in so many directions."""


class OverlapError(ModelError):
    """A model would overlap something."""

    def __init__(self, contact: Contact) -> None:
        super().__init__(f"would overlap by {contact.depth:.2f} m")
        self.contact = contact  #: where it would overlap most


def added(
    engine: Engine, body: Body, pose: Pose, triangles: Triangles, anywhere: bool, search: float
) -> tuple[int, Pose]:
    """Adds a body to the engine, and returns its handle and where it stands.

    Args:
        engine: the engine.
        body: the body.
        pose: of its base.
        triangles: reads meshes.
        anywhere: whether it may overlap anything, as in a world's file.
        search: how far it may be moved to overlap nothing static [m].

    Raises:
        OverlapError: it overlaps something at ``pose``, and is not added.
    """
    pose = _lifted(engine, body, pose, triangles, DEEPEST_START if anywhere else STEP_UP)
    handle = engine.add(body, pose)
    worst = None if anywhere else _deepest(engine.overlap(handle))
    if worst is None:
        return handle, pose
    # A pose that is a little inside a wall is not quite right; one inside another model is a mistake.
    found = _free_pose(engine, handle, pose, search) if worst.other is None else None
    if found is None:
        engine.remove(handle)
        raise OverlapError(worst)
    return handle, found


def _lifted(engine: Engine, body: Body, pose: Pose, triangles: Triangles, most: float) -> Pose:
    """Returns ``pose`` raised by at most ``most`` [m], so that the body stands on what it would overlap."""
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
    """Moves a body to the nearest pose, at most ``bound`` [m] beside ``pose``, where it overlaps nothing.

    Returns:
        That pose, None where there is none; the body stands at one that was tried then.
    """
    x, y, z = pose.position
    for ring in range(1, round(bound / SEARCH_STEP) + 1):
        for number in range(DIRECTIONS):
            angle = math.tau * number / DIRECTIONS
            radius = ring * SEARCH_STEP
            tried = replace(pose, position=(x + radius * math.cos(angle), y + radius * math.sin(angle), z))
            engine.set_pose(handle, tried)
            if _deepest(engine.overlap(handle)) is None:
                return tried
    return None


def _deepest(contacts: Sequence[Contact]) -> Contact | None:
    """Returns the contact in which something overlaps too much to start with, None where there is none."""
    worst = max(contacts, key=lambda contact: contact.depth, default=None)
    return worst if worst is not None and worst.depth > DEEPEST_START else None
