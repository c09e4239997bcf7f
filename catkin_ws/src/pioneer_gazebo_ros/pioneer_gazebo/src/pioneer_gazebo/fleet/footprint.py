"""A robot's footprint: the outline of its collision shapes on the floor."""

from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pioneer_gazebo.body.body import Body, body_from_robot
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.fleet.fleet_description import BASE
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Box, Cylinder, Mesh, Shape, Sphere
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.section import Triangles
from pioneer_gazebo.world.urdf import robot_from_urdf

CIRCLE_CORNERS = 16
"""Corners of the polygon that is drawn about a round shape."""


def footprint(urdf: str) -> list[list[float]]:
    """Returns the corners [m] of a robot's outline on the floor, about `BASE`, with all joints at 0.

    It is convex and contains all collision shapes.

    Raises:
        DescriptionError: the description is invalid, has no collision shape, or one that cannot be read.
    """
    robot = robot_from_urdf(urdf)
    described = sum(1 for _ in ElementTree.fromstring(urdf).iterfind("link/collision"))
    missing = described - sum(len(link.collisions) for link in robot.links)
    if missing > 0:
        raise DescriptionError(
            f"{missing} of the {described} collision shapes of robot {robot.name} cannot be read"
        )
    body = body_from_robot(robot, triangles_of_mesh)
    points = np.concatenate([np.empty((0, 2)), *_outlines(body, triangles_of_mesh)])
    try:
        corners = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        # No points, or all on one line.
        raise DescriptionError(
            f"robot {robot.name} has no collision shape, and so no footprint"
        ) from None
    return [[round(float(x), 3), round(float(y), 3)] for x, y in corners]


def _outlines(body: Body, triangles: Triangles) -> Iterator[NDArray[np.float64]]:
    """Yields for each shape points (n, 2) [m] of `BASE`'s frame whose convex hull contains it from above."""
    part, at = body.part_of(BASE)
    to_base = body.frames()[part].compose(at).inverse()
    for touch, pose in body.placed():
        # A wheel's ball is wider than the wheel, whose drum is a shape of its own.
        if not touch.rolling:
            corners = _corners(touch.collision.shape, to_base.compose(pose), triangles)
            yield corners[:, :2]


def _corners(shape: Shape, pose: Pose, triangles: Triangles) -> NDArray[np.float64]:
    """Returns points (n, 3) whose convex hull contains a shape at ``pose``."""
    match shape:
        case Box(size=size):
            halves = np.array(size) / 2
            signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
            local = signs * halves
        case Cylinder(radius=radius, length=length):
            rim = _circle(radius)
            local = np.concatenate(
                [np.column_stack([rim, np.full(len(rim), z)]) for z in (-length / 2, length / 2)]
            )
        case Sphere(radius=radius):
            # From above a ball is a circle, however it is turned.
            rim = _circle(radius)
            return np.column_stack([rim, np.zeros(len(rim))]) + np.array(pose.position)
        case Mesh():
            local = triangles(shape).reshape(-1, 3)
        case _:
            local = np.empty((0, 3))
    matrix = pose.matrix()
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def _circle(radius: float) -> NDArray[np.float64]:
    """Returns the corners (n, 2) of a regular polygon that contains a circle."""
    angles = np.arange(CIRCLE_CORNERS) * 2 * np.pi / CIRCLE_CORNERS
    reach = radius / np.cos(np.pi / CIRCLE_CORNERS)
    return reach * np.column_stack([np.cos(angles), np.sin(angles)])
