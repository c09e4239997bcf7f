"""Where a model may be added: on what is below it, and clear of everything else."""

from collections.abc import Sequence
from dataclasses import replace

from pioneer_gazebo.core.body import Body, lowest_points
from pioneer_gazebo.core.engine import Contact, Engine
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.section import Triangles

DEEPEST_START = 0.02
"""A model may be spawned at most this far [m] inside something else."""

GROUND_GAP = 0.0005
"""What is spawned in the ground is lifted until it is this far [m] above."""

STEP_UP = 0.3
"""What is spawned at most this far [m] below the top of something is lifted on to it."""


def lifted(engine: Engine, body: Body, pose: Pose, triangles: Triangles, most: float = STEP_UP) -> Pose:
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


def deepest(contacts: Sequence[Contact]) -> Contact | None:
    """Returns the contact in which something overlaps too much to start with, None where there is none."""
    worst = max(contacts, key=lambda contact: contact.depth, default=None)
    return worst if worst is not None and worst.depth > DEEPEST_START else None
