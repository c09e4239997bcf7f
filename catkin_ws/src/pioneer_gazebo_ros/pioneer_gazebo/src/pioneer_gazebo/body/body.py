"""Rigid bodies for the engine: a robot's links, merged over fixed joints into a tree of rigid parts.

As in Gazebo, a link behind a fixed joint is merged into its parent link, with its shapes and its mass.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pioneer_gazebo.body.wheel import Touch, as_balls, is_wheel
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.model import (
    Box,
    Collision,
    Cylinder,
    Inertia,
    Link,
    Mesh,
    Model,
    Plane,
    Shape,
    Sphere,
    Visual,
)
from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector
from pioneer_gazebo.world.robot import DiffDrive, PlanarMove, Robot
from pioneer_gazebo.world.section import Triangles

LEAST_MASS = 1e-3
"""Minimum mass [kg], also given to lighter parts: no solver works with zero mass."""

LED_MASS = 1e5
"""Mass of a scripted (led) body [kg], large enough that nothing it collides with slows it down."""

LED_INERTIA = Inertia(LED_MASS, LED_MASS, LED_MASS)

HELD = 0.0, Inertia()
"""Mass [kg] and inertia of a part that nothing moves."""

_LEAST_MOMENT = 0.4 * LEAST_MASS * 0.05**2
"""Moment of inertia of a ball of the minimum mass [kg m²]."""


@dataclass(frozen=True, slots=True)
class Part:
    """One rigid part of a body."""

    name: str  #: name of its first link
    parent: int  #: index of the parent part; -1 for the base
    joint: (
        Joint | None
    )  #: the joint to its parent, with its pose in the parent part's frame; None for the base
    mass: float  #: [kg]; 0 for a fixed base
    inertia: Inertia  #: principal moments; the pose is that of the centre of mass and the principal axes in the part
    touches: tuple[Touch, ...]  #: collision shapes
    frames: tuple[
        tuple[str, Pose], ...
    ]  #: (link name, pose in the part) of every link merged into it
    visuals: tuple[Visual, ...] = ()  #: shapes seen by cameras; poses are in the part's frame
    weightless: tuple[float, Vector] | None = (
        None  #: mass without gravity [kg] and its centre; None for none
    )


@dataclass(frozen=True, slots=True)
class Body:
    """A tree of parts, base first and depth first: each part is directly followed by its descendants."""

    name: str  #: name of the model
    parts: tuple[Part, ...]  #: all parts
    led: bool = False  #: whether it is scripted: it pushes bodies, is not pushed, and passes through static ones

    def part_of(self, link: str) -> tuple[int, Pose]:
        """Returns the index of the part that contains ``link``, and the link's pose in it.

        Raises:
            KeyError: there is no such link.
        """
        for index, part in enumerate(self.parts):
            for name, pose in part.frames:
                if name == link:
                    return index, pose
        raise KeyError(link)

    def frames(self, base: Pose = IDENTITY) -> list[Pose]:
        """Returns the pose of each part's frame with the base at ``base`` and all joints at 0."""
        frames: list[Pose] = []
        for part in self.parts:
            frames.append(
                base if part.joint is None else frames[part.parent].compose(part.joint.pose)
            )
        return frames

    def placed(self, base: Pose = IDENTITY) -> Iterator[tuple[Touch, Pose]]:
        """Yields each shape with its pose, as for `frames`."""
        for part, frame in zip(self.parts, self.frames(base), strict=True):
            for touch in part.touches:
                yield touch, frame.compose(touch.collision.pose)

    def joint_index(self, joint: str) -> int:
        """Returns the index of the part that ``joint`` moves.

        Raises:
            KeyError: there is no such joint, or it is fixed.
        """
        for index, part in enumerate(self.parts):
            if part.joint is not None and part.joint.name == joint:
                return index
        raise KeyError(joint)


def body_from_model(model: Model, triangles: Triangles) -> Body:
    """Returns a dynamic model as one body in the model's frame; links without joints are merged.

    Args:
        model: the model.
        triangles: reads meshes.
    """
    if model.joints and model.script is None:
        held = Link(kinds.WORLD)
        root = held if any(one.parent == kinds.WORLD for one in model.joints) else model.links[0]
        return Body(model.name, _parts(model, root, root.pose, triangles))
    group = [(link, link.pose) for link in model.links]
    mass, inertia = _lumped(group)
    if model.script is not None:
        mass, inertia = LED_MASS, LED_INERTIA
    elif any(link.is_kinematic for link in model.links):
        mass, inertia = HELD
    touches = tuple(Touch(k.name, _moved(c, k.pose)) for k in model.links for c in k.collisions)
    frames = tuple((link.name, link.pose) for link in model.links)
    weightless = _weightless(group) if model.script is None else None
    part = Part(model.name, -1, None, mass, inertia, touches, frames, _looks(group), weightless)
    return Body(model.name, (part,), model.script is not None)


def body_from_robot(robot: Robot, triangles: Triangles) -> Body:
    """Returns the robot as a body for the engine; ``triangles`` reads meshes.

    Raises:
        DescriptionError: the robot has a floating joint, which is not supported.
    """
    parts = _parts(robot, robot.root, IDENTITY, triangles)
    if robot.of(PlanarMove):
        # Without friction, wheels do not resist a planar-move base.
        parts = tuple(
            replace(
                part,
                touches=tuple(
                    replace(t, collision=replace(t.collision, friction=0.0)) for t in part.touches
                ),
            )
            for part in parts
        )
    return Body(robot.name, parts)


_Group = list[tuple[Link, Pose]]
"""Links merged into one part, each with its pose in the part."""


def _parts(owner: Robot | Model, root: Link, at: Pose, triangles: Triangles) -> tuple[Part, ...]:
    """Returns an owner's parts in the frame in which ``root`` has pose ``at``, its wheels, driven or not, as balls."""
    groups = _groups(owner, root, at)
    drives = [device for device in owner.devices if isinstance(device, DiffDrive)]
    driven = {joint for drive in drives for side in drive.joints() for joint in side}
    index = {group[0][0].name: number for number, group in enumerate(groups)}
    home = {link.name: (index[group[0][0].name], pose) for group in groups for link, pose in group}
    movable = {joint.child: joint for joint in owner.joints if joint.kind != kinds.FIXED}
    touches: list[list[Touch]] = [
        [Touch(k.name, _moved(c, p)) for k, p in g for c in k.collisions] for g in groups
    ]
    parts: list[Part] = []
    frames: list[Pose] = []
    for number, group in enumerate(groups):
        joint = movable.get(group[0][0].name)
        parent = -1
        if joint is not None:
            parent, parent_pose = home[joint.parent]
            joint = replace(joint, pose=parent_pose.compose(joint.pose))
            if joint.name in driven or is_wheel(touches[number], joint, frames[parent], triangles):
                touches[number], drums = as_balls(touches[number], joint, triangles)
                touches[parent] += drums
        frames.append(IDENTITY if joint is None else frames[parent].compose(joint.pose))
        is_kinematic = any(link.is_kinematic for link, _ in group)
        held = group[0][0].name == kinds.WORLD or (not number and (owner.static or is_kinematic))
        mass, inertia = HELD if held else _lumped(group)
        names = tuple((link.name, pose) for link, pose in group if link.name != kinds.WORLD)
        looks, weightless = _looks(group), None if held else _weightless(group)
        name = group[0][0].name
        parts.append(Part(name, parent, joint, mass, inertia, (), names, looks, weightless))
    return tuple(replace(p, touches=tuple(t)) for p, t in zip(parts, touches, strict=True))


def _groups(owner: Robot | Model, root: Link, at: Pose) -> list[_Group]:
    """Groups links connected by fixed joints, base first and depth first, with their poses in the part.

    A part's frame is that of the joint that moves it; the base's frame is the one in which ``root`` has pose ``at``.
    """
    links = {link.name: link for link in owner.links}
    children: dict[str, list[Joint]] = {}
    for joint in owner.joints:
        if joint.kind == kinds.FLOATING:
            raise DescriptionError(
                f"robot {owner.name}: joint {joint.name} is floating, which is not supported"
            )
        children.setdefault(joint.parent, []).append(joint)
    groups: list[_Group] = []
    starts = [(root, at)]
    while starts:
        group: _Group = []
        behind: list[tuple[Link, Pose]] = []
        pending = [starts.pop(0)]
        while pending:
            link, pose = pending.pop(0)
            group.append((link, pose))
            for joint in children.get(link.name, ()):
                if joint.kind == kinds.FIXED:
                    pending.append(
                        (links[joint.child], pose.compose(joint.pose).compose(joint.offset))
                    )
                else:
                    behind.append((links[joint.child], joint.offset))
        groups.append(group)
        starts = behind + starts
    return groups


def _looks(group: _Group) -> tuple[Visual, ...]:
    return tuple(
        replace(one, pose=pose.compose(one.pose)) for link, pose in group for one in link.visuals
    )


def _moved(collision: Collision, pose: Pose) -> Collision:
    return replace(collision, pose=pose.compose(collision.pose))


def _lumped(group: list[tuple[Link, Pose]]) -> tuple[float, Inertia]:
    """Returns the combined mass and principal inertia of rigidly connected links, in the part's frame."""
    heavy = [(link, pose.compose(link.inertia.pose)) for link, pose in group if link.mass > 0]
    mass = sum(link.mass for link, _ in heavy)
    if mass < LEAST_MASS:
        return LEAST_MASS, Inertia(_LEAST_MOMENT, _LEAST_MOMENT, _LEAST_MOMENT)
    centre = sum((link.mass * np.array(at.position) for link, at in heavy), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for link, at in heavy:
        turn = at.matrix()[:3, :3]
        arm = np.array(at.position) - centre
        i = link.inertia
        own = np.array([(i.ixx, i.ixy, i.ixz), (i.ixy, i.iyy, i.iyz), (i.ixz, i.iyz, i.izz)])
        tensor += turn @ own @ turn.T + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, centre
    ixx, iyy, izz = (max(float(moment), 1e-9) for moment in moments)
    return mass, Inertia(ixx, iyy, izz, pose=Pose.from_matrix(matrix))


def _weightless(group: _Group) -> tuple[float, Vector] | None:
    """Returns the mass of links without gravity [kg] and its centre in the part's frame; None for none."""
    masses = [
        (link.mass, pose.compose(link.inertia.pose).position)
        for link, pose in group
        if link.mass > 0 and not link.has_gravity
    ]
    mass = sum(one for one, _ in masses)
    if mass == 0:
        return None
    x, y, z = (sum(one * at[axis] for one, at in masses) / mass for axis in range(3))
    return mass, (x, y, z)


def lowest_points(body: Body, pose: Pose, triangles: Triangles) -> list[Vector]:
    """Returns for each shape of the body at ``pose``, joints at 0, its x, y and the z of its lowest point [m]."""
    return [
        (*placed.position[:2], heights(touch.collision.shape, placed, triangles)[0])
        for touch, placed in body.placed(pose)
    ]


def heights(shape: Shape, pose: Pose, triangles: Triangles) -> tuple[float, float]:
    """Returns the heights [m] of a shape's lowest and highest point at ``pose``; for a plane, of its origin."""
    up = pose.matrix()[2, :3]
    z = pose.position[2]
    match shape:
        case Box(size=size):
            reach = float(abs(up) @ np.array(size)) / 2
        case Cylinder(radius=radius, length=length):
            reach = (
                radius * math.sqrt(max(0.0, 1 - float(up[2]) ** 2)) + abs(float(up[2])) * length / 2
            )
        case Sphere(radius=radius):
            reach = radius
        case Mesh():
            along = triangles(shape).reshape(-1, 3) @ up
            return z + float(along.min()), z + float(along.max())
        case Plane():
            reach = 0.0
    return z - reach, z + reach
