"""Data model of a world, independent of file formats and engine. SI units: lengths [m], masses [kg]."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from pioneer_gazebo.core.joint import Joint
from pioneer_gazebo.core.pose import IDENTITY, Pose, Vector
from pioneer_gazebo.core.script import Script

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
    """A triangle mesh in the file ``path`` (STL, OBJ or Collada), scaled along its own axes."""

    path: str
    scale: Vector = (1.0, 1.0, 1.0)


Shape = Box | Cylinder | Sphere | Plane | Mesh


@dataclass(frozen=True, slots=True)
class Collision:
    """A collision shape, which lasers also see."""

    name: str  #: unique in its link
    pose: Pose  #: pose of the shape in the link
    shape: Shape  #: the shape
    friction: float = 1.0  #: Coulomb coefficient along the first direction (SDF's ``mu``, URDF's ``mu1``)
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
    namespace: str = ""  #: topic namespace set by a plugin; used if the model is spawned without a namespace

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
