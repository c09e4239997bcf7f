"""Rigid bodies for the engine: a robot's links, merged over fixed joints into a tree of rigid parts.

As in Gazebo, a link behind a fixed joint is merged into its parent link, with its shapes and its mass.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core import joint as kinds
from pioneer_gazebo.core.device import PlanarMove
from pioneer_gazebo.core.error import DescriptionError
from pioneer_gazebo.core.joint import Joint
from pioneer_gazebo.core.pose import IDENTITY, Pose, Vector
from pioneer_gazebo.core.robot import DiffDrive, Robot
from pioneer_gazebo.core.section import Triangles
from pioneer_gazebo.core.wheel import Touch, as_balls, is_wheel
from pioneer_gazebo.core.world import Box, Collision, Cylinder, Inertia, Link, Mesh, Model, Plane, Shape, Sphere, Visual

LEAST_MASS = 1e-3
"""Minimum mass [kg], also given to lighter parts: no solver works with zero mass."""

LED_MASS = 1e5
"""Mass of a scripted (led) body [kg], large enough that nothing it collides with slows it down."""

LED_INERTIA = Inertia(LED_MASS, LED_MASS, LED_MASS)


@dataclass(frozen=True, slots=True)
class Part:
    """One rigid part of a body."""

    name: str  #: name of its first link
    parent: int  #: index of the parent part; -1 for the base
    joint: Joint | None  #: the joint to its parent, with its pose in the parent part's frame; None for the base
    mass: float  #: [kg]; 0 for a fixed base
    inertia: Inertia  #: principal moments; the pose is that of the centre of mass and the principal axes in the part
    touches: tuple[Touch, ...]  #: collision shapes
    frames: tuple[tuple[str, Pose], ...]  #: (link name, pose in the part) of every link merged into it
    visuals: tuple[Visual, ...] = ()  #: shapes seen by cameras; poses are in the part's frame


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
        links = {link.name: link for link in model.links}
        held = Link(kinds.WORLD)
        root = held if any(one.parent == kinds.WORLD for one in model.joints) else model.links[0]
        groups = _groups(model.name, root, root.pose, links.__getitem__, model.joints)
        return Body(model.name, _parts(groups, model.joints, _wheels_of(model.devices, triangles)))
    group = [(link, link.pose) for link in model.links]
    mass, inertia = (LED_MASS, LED_INERTIA) if model.script is not None else _lumped(group)
    touches = tuple(Touch(k.name, _moved(c, k.pose)) for k in model.links for c in k.collisions)
    frames = tuple((link.name, link.pose) for link in model.links)
    part = Part(model.name, -1, None, mass, inertia, touches, frames, _looks(group))
    return Body(model.name, (part,), model.script is not None)


def body_from_robot(robot: Robot, triangles: Triangles) -> Body:
    """Returns the robot as a body for the engine; ``triangles`` reads meshes.

    Raises:
        DescriptionError: the robot has a floating joint, which is not supported.
    """
    groups = _groups(robot.name, robot.root, IDENTITY, robot.link, robot.joints)
    parts = _parts(groups, robot.joints, _wheels_of(robot.devices, triangles), robot.static)
    return Body(robot.name, _gliding(parts) if robot.of(PlanarMove) else parts)


def _gliding(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """Returns the parts without friction, so that wheels do not resist a planar-move base."""
    return tuple(
        replace(part, touches=tuple(replace(t, collision=replace(t.collision, friction=0.0)) for t in part.touches))
        for part in parts
    )


def _wheels_of(devices: Iterable[object], triangles: Triangles) -> "_Wheels":
    """Returns a function that converts wheel parts: driven ones and passive ones."""
    drives = [device for device in devices if isinstance(device, DiffDrive)]
    driven = {joint for drive in drives for side in drive.joints() for joint in side}

    def rolling(touches: Sequence[Touch], joint: Joint, parent: Pose) -> _Rolling | None:
        is_driven = joint.name in driven
        return as_balls(touches, joint, triangles) if is_driven or is_wheel(touches, joint, parent, triangles) else None

    return rolling


_Group = list[tuple[Link, Pose]]
"""Links merged into one part, each with its pose in the part."""

_Rolling = tuple[list[Touch], list[Touch]]
"""A wheel's shapes, and those handed over to its parent."""

_Wheels = Callable[[Sequence[Touch], Joint, Pose], _Rolling | None]
"""Returns the conversion of a part by its shapes, joint and parent's pose; None if it is not a wheel."""


def _parts(
    groups: list[_Group],
    joints: Sequence[Joint],
    rolling: _Wheels,
    static: bool = False,
) -> tuple[Part, ...]:
    """Returns a part for each group; ``rolling`` converts wheels (shapes, joint, parent's pose)."""
    index = {group[0][0].name: number for number, group in enumerate(groups)}
    home = {link.name: (index[group[0][0].name], pose) for group in groups for link, pose in group}
    movable = {joint.child: joint for joint in joints if joint.kind != kinds.FIXED}
    touches: list[list[Touch]] = [[Touch(k.name, _moved(c, p)) for k, p in g for c in k.collisions] for g in groups]
    parts: list[Part] = []
    frames: list[Pose] = []
    for number, group in enumerate(groups):
        joint = movable.get(group[0][0].name)
        parent = -1
        if joint is not None:
            parent, parent_pose = home[joint.parent]
            joint = replace(joint, pose=parent_pose.compose(joint.pose))
            found = rolling(touches[number], joint, frames[parent])
            if found is not None:
                touches[number], drums = found
                touches[parent] += drums
        frames.append(IDENTITY if joint is None else frames[parent].compose(joint.pose))
        held = group[0][0].name == kinds.WORLD or (static and not number)
        mass, inertia = (0.0, Inertia()) if held else _lumped(group)
        names = tuple((link.name, pose) for link, pose in group if link.name != kinds.WORLD)
        parts.append(Part(group[0][0].name, parent, joint, mass, inertia, (), names, _looks(group)))
    return tuple(replace(p, touches=tuple(t)) for p, t in zip(parts, touches, strict=True))


def _groups(name: str, root: Link, at: Pose, link_of: Callable[[str], Link], joints: Iterable[Joint]) -> list[_Group]:
    """Groups links connected by fixed joints, base first and depth first, with their poses in the part.

    A part's frame is that of the joint that moves it; the base's frame is the one in which ``root`` has pose ``at``.
    """
    children: dict[str, list[Joint]] = {}
    for joint in joints:
        if joint.kind == kinds.FLOATING:
            raise DescriptionError(f"robot {name}: joint {joint.name} is floating, which is not supported")
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
                    pending.append((link_of(joint.child), pose.compose(joint.pose).compose(joint.offset)))
                else:
                    behind.append((link_of(joint.child), joint.offset))
        groups.append(group)
        starts = behind + starts
    return groups


def _looks(group: _Group) -> tuple[Visual, ...]:
    return tuple(replace(one, pose=pose.compose(one.pose)) for link, pose in group for one in link.visuals)


def _moved(collision: Collision, pose: Pose) -> Collision:
    return replace(collision, pose=pose.compose(collision.pose))


def _tensor(inertia: Inertia) -> NDArray[np.float64]:
    i = inertia
    return np.array([(i.ixx, i.ixy, i.ixz), (i.ixy, i.iyy, i.iyz), (i.ixz, i.iyz, i.izz)])


def _lumped(group: list[tuple[Link, Pose]]) -> tuple[float, Inertia]:
    """Returns the combined mass and principal inertia of rigidly connected links, in the part's frame."""
    heavy = [(link, pose.compose(link.inertia.pose)) for link, pose in group if link.mass > 0]
    mass = sum(link.mass for link, _ in heavy)
    if mass < LEAST_MASS:
        return LEAST_MASS, _ball_inertia(LEAST_MASS, 0.05)
    centre = sum((link.mass * np.array(at.position) for link, at in heavy), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for link, at in heavy:
        turn = at.matrix()[:3, :3]
        arm = np.array(at.position) - centre
        tensor += turn @ _tensor(link.inertia) @ turn.T + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, centre
    ixx, iyy, izz = (max(float(moment), 1e-9) for moment in moments)
    return mass, Inertia(ixx, iyy, izz, pose=Pose.from_matrix(matrix))


def _ball_inertia(mass: float, radius: float) -> Inertia:
    moment = 0.4 * mass * radius * radius
    return Inertia(moment, moment, moment)


def lowest_points(body: Body, pose: Pose, triangles: Triangles) -> list[Vector]:
    """Returns for each shape of the body at ``pose``, joints at 0, its x, y and the z of its lowest point [m]."""
    frames = [pose]
    points = []
    for number, part in enumerate(body.parts):
        if number:
            assert part.joint is not None
            frames.append(frames[part.parent].compose(part.joint.pose))
        for touch in part.touches:
            placed = frames[number].compose(touch.collision.pose)
            x, y, _ = placed.position
            points.append((x, y, heights(touch.collision.shape, placed, triangles)[0]))
    return points


def heights(shape: Shape, pose: Pose, triangles: Triangles) -> tuple[float, float]:
    """Returns the heights [m] of a shape's lowest and highest point at ``pose``; for a plane, of its origin."""
    up = pose.matrix()[2, :3]
    z = pose.position[2]
    match shape:
        case Box(size=size):
            reach = float(abs(up) @ np.array(size)) / 2
        case Cylinder(radius=radius, length=length):
            reach = radius * math.sqrt(max(0.0, 1 - float(up[2]) ** 2)) + abs(float(up[2])) * length / 2
        case Sphere(radius=radius):
            reach = radius
        case Mesh():
            along = triangles(shape).reshape(-1, 3) @ up
            return z + float(along.min()), z + float(along.max())
        case Plane():
            reach = 0.0
    return z - reach, z + reach
