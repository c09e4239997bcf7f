"""Checks bounds of all values passed to the engine; beyond them it fails or computes meaningless results."""

import math
from collections.abc import Iterable

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.error import BoundError
from pioneer_gazebo.physics.engine import Physics, Velocity
from pioneer_gazebo.world.model import Box, Collision, Cylinder, Mesh, PlacedCollision, Sphere
from pioneer_gazebo.world.pose import Pose, Vector

FARTHEST = 1e6
"""Maximum distance from the origin [m]."""

FASTEST = 1e3
"""Maximum speed [m/s and rad/s]."""

STRONGEST = 1e9
"""Maximum force [N] and torque [N m]."""

HEAVIEST = 1e9
"""Maximum mass [kg] and moment of inertia [kg m²]."""

LARGEST = 1e5
"""Maximum shape size in any direction [m]."""

SMALLEST = 1e-6
"""Minimum shape size in any direction [m]."""

GREATEST_GRAVITY = 1e3
"""Maximum gravity [m/s²]."""

MOST_ITERATIONS = 1000


def check_pose(pose: Pose) -> None:
    """Checks a pose in the world.

    Raises:
        BoundError: it is not finite, or too far away.
    """
    check("position", pose.position, FARTHEST, "m")
    check("rotation", pose.rotation, 2.0, "")


def check_velocity(velocity: Velocity) -> None:
    """Checks a velocity; raises BoundError if it is not finite or too fast."""
    check("velocity", velocity.linear, FASTEST, "m/s")
    check("turn rate", velocity.angular, FASTEST, "rad/s")


def check_wrench(force: Vector, torque: Vector, point: Vector) -> None:
    """Checks a force, a torque, and the point of application; raises BoundError."""
    check("force", force, STRONGEST, "N")
    check("torque", torque, STRONGEST, "N m")
    check("point", point, FARTHEST, "m")


def check_physics(physics: Physics) -> None:
    """Checks settings of the engine; raises BoundError."""
    check("gravity", physics.gravity, GREATEST_GRAVITY, "m/s²")
    if not 1 <= physics.iterations <= MOST_ITERATIONS:
        raise BoundError(
            f"solver iterations must be 1 … {MOST_ITERATIONS} (got {physics.iterations})"
        )


def check_body(body: Body) -> None:
    """Checks masses, inertias, shapes and joints of a body.

    Raises:
        BoundError: a value is out of bounds; the message names the part.
    """
    for part in body.parts:
        inertia = part.inertia
        try:
            check("mass", (part.mass,), HEAVIEST, "kg")
            check("inertia", (inertia.ixx, inertia.iyy, inertia.izz), HEAVIEST, "kg m²")
            check("centre of mass", inertia.pose.position, FARTHEST, "m")
            for touch in part.touches:
                _check_collision(touch.collision)
            if part.joint is not None:
                joint = part.joint
                check("position of a joint", joint.pose.position, FARTHEST, "m")
                check("damping and friction", (joint.damping, joint.friction), STRONGEST, "")
        except BoundError as error:
            raise BoundError(f"{body.name}, link {part.name}: {error}") from None


def check_placed(placed: Iterable[PlacedCollision]) -> None:
    """Checks shapes of static models; raises BoundError."""
    for one in placed:
        try:
            check_pose(one.pose)
            _check_collision(one.collision)
        except BoundError as error:
            raise BoundError(f"{one.model.name}, link {one.link.name}: {error}") from None


def is_sound(pose: Pose) -> bool:
    """Returns whether a body at this pose can still be simulated."""
    x, y, z = pose.position
    # Comparisons with NaN are false.
    return -FARTHEST < x < FARTHEST and -FARTHEST < y < FARTHEST and -FARTHEST < z < FARTHEST


def _check_collision(collision: Collision) -> None:
    check("position of a shape", collision.pose.position, FARTHEST, "m")
    check("friction and restitution", (collision.friction, collision.restitution), FARTHEST, "")
    shape = collision.shape
    sizes: tuple[float, ...] = ()
    if isinstance(shape, Box):
        sizes = shape.size
    elif isinstance(shape, Cylinder):
        sizes = shape.radius, shape.length
    elif isinstance(shape, Sphere):
        sizes = (shape.radius,)
    elif isinstance(shape, Mesh):
        sizes = (abs(shape.scale[0]), abs(shape.scale[1]), abs(shape.scale[2]))
    if any(not SMALLEST <= size <= LARGEST for size in sizes):
        words = " ".join(f"{size:g}" for size in sizes)
        raise BoundError(
            f"size of collision {collision.name} must be {SMALLEST:g} … {LARGEST:g} (got {words})"
        )


def check(what: str, values: Iterable[float], most: float, unit: str) -> None:
    """Checks that values are finite and at most ``most`` [unit]; raises BoundError."""
    values = tuple(values)
    if not all(math.isfinite(value) and abs(value) <= most for value in values):
        words = " ".join(f"{value:g}" for value in values)
        limit = f" and at most {most:g} {unit}".rstrip()
        raise BoundError(f"{what} must be finite{limit} (got {words})")
