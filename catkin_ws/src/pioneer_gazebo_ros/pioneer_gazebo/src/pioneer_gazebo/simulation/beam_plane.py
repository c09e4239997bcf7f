"""What a laser that is not level sees: the world cut with the plane of its beams.

The plane moves with the robot, so each scan cuts the world again; a level laser's sections are cached by the scene.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.world.model import Box, Cylinder, Mesh, PlacedCollision, Plane, Shape, Sphere
from pioneer_gazebo.world.pose import Pose, rotated
from pioneer_gazebo.world.section import EMPTY, Section, Triangles, section_of

LEVEL = math.cos(0.01)
"""A laser is level if its axis and that of the robot's base enclose less than 0.01 rad: cosine of the angle."""


class BeamPlane:
    """Cuts the world with the plane of a laser's beams."""

    def __init__(self, triangles: Triangles) -> None:
        """Takes the function that reads meshes."""
        self._triangles = triangles
        self._radii: dict[Shape, float] = {}

    def section(
        self,
        sensor: Pose,
        reach: float,
        standing: Sequence[PlacedCollision],
        moving: Iterable[tuple[Body, Pose]],
    ) -> Section:
        """Returns what is cut, in the sensor's frame.

        Args:
            sensor: pose in the world; its x and y axes span the plane.
            reach: length of the beams [m]; what is farther away may be missing.
            standing: the static world, with its ground.
            moving: the outlines of moving bodies, with the poses of their base frames.
        """
        to_sensor = sensor.inverse()
        placed = [(one.collision.shape, to_sensor.compose(one.pose)) for one in standing]
        for body, pose in moving:
            placed += [
                (touch.collision.shape, at)
                for touch, at in body.placed(to_sensor.compose(pose))
                if not touch.rolling
            ]
        return Section.joined(self._cut(shape, pose, reach) for shape, pose in placed)

    def _cut(self, shape: Shape, pose: Pose, reach: float) -> Section:
        """Cuts a shape at ``pose`` in the sensor's frame."""
        if isinstance(shape, Plane):
            return _cut_plane(shape, pose, reach)
        radius = self._radius(shape)
        x, y, z = pose.position
        if abs(z) > radius or math.hypot(x, y) > reach + radius:
            return EMPTY
        return section_of(shape, pose, 0.0, self._triangles)

    def _radius(self, shape: Shape) -> float:
        """Returns the radius [m] of a ball about the shape's origin that contains it."""
        found = self._radii.get(shape)
        if found is None:
            found = self._radii[shape] = self._radius_of(shape)
        return found

    def _radius_of(self, shape: Shape) -> float:
        match shape:
            case Box(size=size):
                return math.hypot(*size) / 2
            case Cylinder(radius=radius, length=length):
                return math.hypot(radius, length / 2)
            case Sphere(radius=radius):
                return radius
            case Mesh():
                corners = self._triangles(shape).reshape(-1, 3)
                return float(np.linalg.norm(corners, axis=1).max(initial=0.0))
            case Plane():
                return math.inf


def _cut_plane(plane: Plane, pose: Pose, reach: float) -> Section:
    """Returns the line in which a plane at ``pose`` meets z = 0, as a segment that no beam passes beside."""
    nx, ny, nz = rotated(pose.rotation, plane.normal)
    x, y, z = pose.position
    across = math.hypot(nx, ny)
    if across < 1e-9 * abs(nz) + 1e-12:
        return EMPTY
    distance = (nx * x + ny * y + nz * z) / across
    if abs(distance) > reach:
        return EMPTY
    ahead = (nx / across, ny / across)
    along = (-ahead[1], ahead[0])
    start = [distance * a - reach * b for a, b in zip(ahead, along, strict=True)]
    return Section(np.array([[*start, 2 * reach * along[0], 2 * reach * along[1]]]), EMPTY.circles)
