"""Data model of a world, independent of file formats and engine. SI units: lengths [m], masses [kg]."""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector, between


@dataclass(frozen=True, slots=True)
class Waypoint:
    """The model's pose in the world at ``time`` [s] after the start of its trajectory."""

    time: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A path through waypoints (SDF's ``<actor><script>``); the model waits at the first waypoint until its time.

    As in Gazebo, positions follow a cardinal spline; rotations are interpolated the short way.
    """

    waypoints: tuple[Waypoint, ...]  #: one or more, with increasing times >= 0
    #: 0 (Catmull-Rom, which may overshoot corners) … 1 (straight lines, slowing down at each waypoint)
    tension: float = 0.0

    @property
    def duration(self) -> float:
        """The time of the last waypoint [s]."""
        return self.waypoints[-1].time

    def pose(self, time: float) -> Pose:
        """Returns the pose at ``time`` [s] after the trajectory's start."""
        points = self.waypoints
        after = bisect_right(points, time, key=lambda point: point.time)
        if after == 0:
            return points[0].pose
        if after == len(points):
            return points[-1].pose
        a, b = points[after - 1], points[after]
        part = (time - a.time) / (b.time - a.time)
        rotation = between(a.pose, b.pose, part).rotation
        return Pose(self._position(after - 1, part), rotation)

    def _position(self, index: int, part: float) -> Vector:
        """Returns the point of the Hermite curve at ``part`` (0 … 1) of the segment after waypoint ``index``."""
        p, q = self.waypoints[index].pose.position, self.waypoints[index + 1].pose.position
        u, v = self._tangent(index), self._tangent(index + 1)
        s, c = part * part, part * part * part
        a, b, d, e = 2 * c - 3 * s + 1, 3 * s - 2 * c, c - 2 * s + part, c - s
        x, y, z = (a * p[i] + b * q[i] + d * u[i] + e * v[i] for i in range(3))
        return x, y, z

    def _tangent(self, index: int) -> Vector:
        """Returns the curve's tangent at a waypoint; if the path's ends coincide, it is smooth there."""
        points = [point.pose.position for point in self.waypoints]
        last = len(points) - 1
        before, after = points[max(index - 1, 0)], points[min(index + 1, last)]
        if index in (0, last) and math.dist(points[0], points[last]) < 1e-6:
            before, after = points[last - 1], points[1]
        half = (1.0 - self.tension) / 2
        return (
            half * (after[0] - before[0]),
            half * (after[1] - before[1]),
            half * (after[2] - before[2]),
        )


@dataclass(frozen=True, slots=True)
class Script:
    """A model's complete motion, a sequence of trajectories."""

    trajectories: tuple[Trajectory, ...]  #: in playing order
    home: Pose  #: pose before the first trajectory, and always without ``auto_start``
    loop: bool = True  #: whether to repeat from the start
    delay_start: float = 0.0  #: delay before each round [s]
    auto_start: bool = True  #: whether it starts by itself; nothing else can start it here

    def mapped(self, function: Callable[[Pose], Pose]) -> "Script":
        """Returns the script with ``function`` applied to all its poses."""
        trajectories = tuple(
            replace(
                one,
                waypoints=tuple(
                    replace(point, pose=function(point.pose)) for point in one.waypoints
                ),
            )
            for one in self.trajectories
        )
        return replace(self, trajectories=trajectories, home=function(self.home))

    def pose(self, time: float) -> Pose:
        """Returns the model's pose at ``time`` [s] after the start of the script."""
        length = sum(trajectory.duration for trajectory in self.trajectories)
        if not self.auto_start or not self.trajectories:
            return self.home
        rounds, elapsed = 0.0, time
        if self.loop and self.delay_start + length > 0:
            rounds, elapsed = divmod(time, self.delay_start + length)
        elapsed -= self.delay_start
        if elapsed < 0:
            return self.trajectories[-1].pose(math.inf) if rounds else self.home
        for trajectory in self.trajectories:
            if elapsed < trajectory.duration:
                return trajectory.pose(elapsed)
            elapsed -= trajectory.duration
        return self.trajectories[-1].pose(math.inf)


Colour = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """A box centred on its origin; ``size`` is its full extent along x, y, z."""

    size: Vector


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder along z, centred on its origin; ``length`` is its full height."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere centred on its origin."""

    radius: float


@dataclass(frozen=True, slots=True)
class Plane:
    """The half space below a plane through its origin."""

    normal: Vector = (0.0, 0.0, 1.0)  #: points out of the solid
    #: visible extent along x and y; as in Gazebo, the collision shape is infinite
    size: tuple[float, float] = (100.0, 100.0)


@dataclass(frozen=True, slots=True)
class Mesh:
    """A triangle mesh in the file ``path`` (STL, OBJ or Collada) or of ``corners``, scaled along its own axes."""

    path: str  #: empty for a mesh of ``corners``
    scale: Vector = (1.0, 1.0, 1.0)
    corners: tuple[
        Vector, ...
    ] = ()  #: of the triangles of a mesh that is in no file, three for each [m]


Shape = Box | Cylinder | Sphere | Plane | Mesh


@dataclass(frozen=True, slots=True)
class Collision:
    """A collision shape, which lasers also see."""

    name: str  #: unique in its link
    pose: Pose  #: pose of the shape in the link
    shape: Shape  #: the shape
    friction: float = (
        1.0  #: Coulomb coefficient along the first direction (SDF's ``mu``, URDF's ``mu1``)
    )
    restitution: float = 0.0  #: 0 (no bounce) … 1


@dataclass(frozen=True, slots=True)
class Visual:
    """A shape visible to cameras only; ``colour`` is red, green, blue, alpha, each 0 … 1."""

    name: str
    pose: Pose
    shape: Shape
    colour: Colour = (0.7, 0.7, 0.7, 1.0)


@dataclass(frozen=True, slots=True)
class Inertia:
    """Moments and products of inertia [kg m²] about the centre of mass, in the axes of ``pose``."""

    ixx: float = 1.0
    iyy: float = 1.0
    izz: float = 1.0
    ixy: float = 0.0
    ixz: float = 0.0
    iyz: float = 0.0
    pose: Pose = IDENTITY  #: pose of the centre of mass and the axes in the link


UNIT_INERTIA = Inertia()
"""SDF's default inertia."""


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid body with its pose in the model's frame."""

    name: str
    pose: Pose = IDENTITY
    mass: float = 1.0
    inertia: Inertia = UNIT_INERTIA
    collisions: tuple[Collision, ...] = ()
    visuals: tuple[Visual, ...] = ()
    has_gravity: bool = True  #: whether it falls
    is_kinematic: bool = False  #: whether nothing moves it but services


@dataclass(frozen=True, slots=True)
class Model:
    """A named group of links."""

    name: str  #: unique in the world
    pose: Pose = IDENTITY  #: in the world
    static: bool = False  #: whether it is static
    links: tuple[Link, ...] = ()  #: poses are in the model's frame, all joints at 0
    script: Script | None = None  #: script that moves it instead of physics
    #: form a tree of all links (see `joint.tree_of`); empty if all links are rigidly connected
    joints: tuple[Joint, ...] = ()
    devices: tuple[Any, ...] = ()  #: sensors and plugins (see `robot.Device`)
    namespace: str = (
        ""  #: topic namespace set by a plugin; used if the model is spawned without a namespace
    )

    def moved(self, base: Pose) -> "Model":
        """Returns the model with pose and script transformed from ``base``'s frame to the parent frame of ``base``."""
        script = None if self.script is None else self.script.mapped(base.compose)
        return replace(self, pose=base.compose(self.pose), script=script)


@dataclass(frozen=True, slots=True)
class PlacedCollision:
    """A collision of a world's model with its pose in the world."""

    model: Model
    link: Link
    collision: Collision
    pose: Pose


@dataclass(frozen=True, slots=True)
class World:
    """A complete world."""

    name: str  #: name in the file
    models: tuple[Model, ...] = ()  #: in file order, with unique names
    gravity: Vector = (0.0, 0.0, -9.81)  #: acceleration along x, y, z [m/s²]
    #: simulated seconds per wall second that it asks for; 0: as fast as possible; None for none
    real_time_factor: float | None = None
    #: one line for each kind of unsupported element that was ignored
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def collisions(self, static_only: bool = False) -> Iterator[PlacedCollision]:
        """Yields every collision with its pose in the world, in file order."""
        for model in self.models:
            if static_only and not model.static:
                continue
            for link in model.links:
                link_pose = model.pose.compose(link.pose)
                for collision in link.collisions:
                    yield PlacedCollision(model, link, collision, link_pose.compose(collision.pose))
