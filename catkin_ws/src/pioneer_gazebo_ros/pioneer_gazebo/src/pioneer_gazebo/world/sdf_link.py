"""Reads SDF links (inertia, collisions, visuals and their geometry), joints, and the frames of their poses."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.element import Element, Notes
from pioneer_gazebo.world.joint import CONTINUOUS, FIXED, PRISMATIC, REVOLUTE, WORLD, Joint
from pioneer_gazebo.world.model import (
    Box,
    Collision,
    Colour,
    Cylinder,
    Inertia,
    Link,
    Mesh,
    Plane,
    Shape,
    Sphere,
    Visual,
)
from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector, conjugate, rotated
from pioneer_gazebo.world.prism import prism
from pioneer_gazebo.world.resource import file_of_uri

GREY: Colour = (0.7, 0.7, 0.7, 1.0)
_COLOURS: dict[str, Colour] = {
    "grey": GREY,
    "gray": GREY,
    "darkgrey": (0.175, 0.175, 0.175, 1.0),
    "lightgrey": (0.85, 0.85, 0.85, 1.0),
    "white": (1.0, 1.0, 1.0, 1.0),
    "flatblack": (0.1, 0.1, 0.1, 1.0),
    "black": (0.0, 0.0, 0.0, 1.0),
    "red": (1.0, 0.0, 0.0, 1.0),
    "redbright": (0.87, 0.26, 0.07, 1.0),
    "green": (0.0, 1.0, 0.0, 1.0),
    "blue": (0.0, 0.0, 1.0, 1.0),
    "skyblue": (0.13, 0.44, 0.70, 1.0),
    "yellow": (1.0, 1.0, 0.0, 1.0),
    "zincyellow": (0.97, 0.92, 0.15, 1.0),
    "gold": (0.8, 0.65, 0.0, 1.0),
    "purple": (1.0, 0.0, 1.0, 1.0),
    "turquoise": (0.0, 1.0, 1.0, 1.0),
    "orange": (1.0, 0.51, 0.06, 1.0),
    "indigo": (0.33, 0.0, 0.5, 1.0),
    "wood": (0.65, 0.45, 0.25, 1.0),
    "bricks": (0.6, 0.3, 0.2, 1.0),
}


def colour_of_material(name: str) -> Colour | None:
    """Returns the colour of ``Gazebo/NAME``, ignoring case; None for an unknown name."""
    return _COLOURS.get(name.rpartition("/")[2].lower())


RADIUS_OF_GYRATION = 0.1
"""Assumed for a link with invalid inertia [m]."""


@dataclass(frozen=True)
class Scope:
    """The context for reading one file."""

    directory: Path  #: of the file, base of relative paths
    models: Sequence[Path]  #: search path of ``model://``
    notes: Notes  #: collects what is ignored
    tolerant: bool = False  #: whether invalid elements are ignored with a note, as in Gazebo's worlds, or are errors

    @contextmanager
    def leaving_out(self) -> Iterator[None]:
        """Turns a DescriptionError raised in the block into a note if the scope is tolerant."""
        try:
            yield
        except DescriptionError as error:
            if not self.tolerant:
                raise
            self.notes.add(f"{error}; it is ignored")


def link_from_sdf(
    element: Element, pose: Pose, scope: Scope, frames: "Frames | None" = None
) -> Link:
    """Returns the link of a ``<link>`` element.

    Args:
        element: the ``<link>``.
        pose: of the link in the model, resolved by the caller.
        scope: of the file.
        frames: named frames of the model, to which poses of shapes may be relative.
    """

    def placed(child: Element) -> Pose:
        return _placed_in_link(child, pose, element, frames)

    mass, inertia = _inertial(element.child("inertial"), scope.notes, placed)
    collisions = []
    visuals = []
    for child in element.children("collision", "visual"):
        with scope.leaving_out():
            shape = _shape(child, scope)
            if shape is not None and child.tag == "collision":
                collisions.append(_collision(child, shape, placed(child)))
            elif shape is not None:
                name = child.attribute("name", "visual")
                visuals.append(Visual(name, placed(child), shape, _colour(child)))
    return Link(
        element.attribute("name"),
        pose,
        mass,
        inertia,
        tuple(collisions),
        tuple(visuals),
        element.flag("gravity", True),
        element.flag("kinematic", False),
    )


def _placed_in_link(
    child: Element, link_pose: Pose, link: Element, frames: "Frames | None"
) -> Pose:
    """Returns the pose of a link's child in the link, also if it is given in another frame."""
    pose = child.child("pose")
    frame = "" if pose is None else pose.attribute("relative_to", pose.attribute("frame", ""))
    if frames is None or frame in ("", link.attribute("name", "")):
        return child.placed()
    base = IDENTITY if frame == "__model__" else frames.named(frame, child)
    return link_pose.inverse().compose(base).compose(child.placed())


def _inertial(
    element: Element | None, notes: Notes, placed: Callable[[Element], Pose]
) -> tuple[float, Inertia]:
    """Returns mass and inertia; physically impossible values are replaced by defaults, with a note."""
    if element is None:
        return 1.0, Inertia()
    pose = placed(element)
    mass = element.number("mass", 1.0)
    if mass <= 0:
        element.needed("mass").note(notes, f"must be > 0 (got {mass:g}); 1 kg is taken")
        mass = 1.0
    moments = element.child("inertia")
    if moments is None:
        return mass, Inertia(pose=pose)
    ixx, iyy, izz = (moments.number(tag, 1.0) for tag in ("ixx", "iyy", "izz"))
    if min(ixx, iyy, izz) <= 0:
        moment = mass * RADIUS_OF_GYRATION**2
        moments.note(
            notes,
            f"ixx, iyy, izz must be > 0 (got {ixx:g}, {iyy:g}, {izz:g}); {moment:g} kg m² is taken",
        )
        return mass, Inertia(moment, moment, moment, pose=pose)
    ixy, ixz, iyz = (moments.number(tag, 0.0) for tag in ("ixy", "ixz", "iyz"))
    return mass, Inertia(ixx, iyy, izz, ixy, ixz, iyz, pose)


def _collision(element: Element, shape: Shape, pose: Pose) -> Collision:
    return Collision(
        element.attribute("name", "collision"),
        pose,
        shape,
        friction=element.number("surface/friction/ode/mu", 1.0),
        restitution=element.number("surface/bounce/restitution_coefficient", 0.0),
    )


def _shape(element: Element, scope: Scope) -> Shape | None:
    """Returns the shape in ``<geometry>``; None for an empty one and one of a kind that is not supported."""
    geometry = element.needed("geometry")
    inner = next(geometry.children(), None)
    if inner is not None and inner.tag == "polyline":
        return _prism(list(geometry.children("polyline")))
    if inner is None or inner.tag == "empty":
        return None
    if inner.tag == "box":
        size = inner.needed("size")
        extents = size.vector()
        if min(extents) <= 0:
            raise size.error(f"must be above 0, not {size.text!r}")
        return Box(extents)
    if inner.tag == "cylinder":
        return Cylinder(inner.positive("radius"), inner.positive("length"))
    if inner.tag == "sphere":
        return Sphere(inner.positive("radius"))
    if inner.tag == "plane":
        normal, extent = inner.child("normal"), inner.child("size")
        width, depth = (100.0, 100.0) if extent is None else extent.numbers(2)
        return Plane((0.0, 0.0, 1.0) if normal is None else normal.direction(), (width, depth))
    if inner.tag == "mesh":
        return _mesh(inner, scope)
    return None


def _prism(polylines: list[Element]) -> Mesh:
    """Returns prisms over polygons."""
    corners: list[Vector] = []
    for element in polylines:
        points = []
        for point in element.children("point"):
            x, y = point.numbers(2)
            points.append((x, y))
        try:
            corners += prism(points, element.positive("height", 1.0))
        except ValueError as error:
            raise element.error(str(error)) from None
    return Mesh("", corners=tuple(corners))


def _mesh(element: Element, scope: Scope) -> Mesh | None:
    uri = element.needed("uri")
    scale = element.child("scale")
    path = file_of_uri(uri.text, scope.directory, scope.models)
    if path is None:
        scope.notes.add(f"mesh {uri.text} is not found and left out")
        return None
    if scale is None:
        return Mesh(str(path))
    factors = scale.vector()
    if 0.0 in factors:
        raise scale.error(f"must not be 0, not {scale.text!r}")
    return Mesh(str(path), factors)


def _colour(element: Element) -> Colour:
    material = element.child("material")
    if material is None:
        return GREY
    for tag in ("diffuse", "ambient"):
        found = material.child(tag)
        if found is not None:
            values = found.numbers(4 if len(found.text.split()) != 3 else 3)
            return values[0], values[1], values[2], values[3] if len(values) == 4 else 1.0
    script = material.child("script/name")
    return (colour_of_material(script.text) if script is not None else None) or GREY


_OWN_FRAME = ("", "world", "__model__")


class Frames:
    """The named frames in one ``<world>`` or ``<model>``."""

    def __init__(self, parent: Element) -> None:
        self._named = {
            name: child
            for child in parent.children("link", "frame", "model", "joint", "include")
            if (name := child.attribute("name", "") or child.word("name", ""))
        }

    def pose(self, element: Element) -> Pose:
        """Returns the element's pose in its world or model.

        Raises:
            DescriptionError: the pose refers to an unknown name or, directly or indirectly, to itself.
        """
        return self._pose(element, ())

    def named(self, name: str, asker: Element) -> Pose:
        """Returns the pose of the frame, link, joint or model of that name.

        Raises:
            DescriptionError: the name is unknown; the error is located at ``asker``.
        """
        if name not in self._named:
            raise asker.error(f"there is no frame {name!r}")
        return self.pose(self._named[name])

    def _pose(self, element: Element, seen: tuple[str, ...]) -> Pose:
        pose = element.child("pose")
        own = element.placed()
        base = "" if pose is None else pose.attribute("relative_to", pose.attribute("frame", ""))
        if not base and element.tag == "frame":
            base = element.attribute("attached_to", "")
        if not base and element.tag == "joint":
            base = element.needed("child").text
        if base in _OWN_FRAME:
            return own
        if base in seen:
            raise element.error(f"poses refer to each other in a loop: {' → '.join((*seen, base))}")
        if base not in self._named:
            raise element.error(f"the pose is relative to unknown frame {base!r}")
        return self._pose(self._named[base], (*seen, base)).compose(own)


KINDS = (FIXED, REVOLUTE, PRISMATIC, CONTINUOUS)
UNLIMITED = 1e15
"""SDF writes ±1e16 for no limit."""


def joint_from_sdf(
    element: Element, links: Mapping[str, Pose], frames: Frames, scope: Scope
) -> Joint:
    """Returns the joint of a ``<joint>`` element; an unsupported type becomes a fixed joint, with a note.

    Args:
        element: the ``<joint>``.
        links: each link's pose in the model.
        frames: the model's named frames.
        scope: of the file.

    Raises:
        DescriptionError: a value is invalid, or a link is unknown.
    """
    name, kind = element.attribute("name"), element.attribute("type")
    ends = [element.needed(tag).text.removeprefix("__model__::") for tag in ("parent", "child")]
    poses = {WORLD: IDENTITY, **links}
    for end in ends:
        if end not in poses:
            raise element.error(f"there is no link {end!r}")
    if kind not in KINDS:
        scope.notes.add(
            f"joint type {kind!r} is not supported: the links it connects are held together"
        )
        kind = FIXED
    parent, child = ends
    own = element.child("pose")
    of_frame = own is not None and own.attribute("relative_to", own.attribute("frame", ""))
    at = frames.pose(element) if of_frame else poses[child].compose(element.placed())
    own_frame, offset = poses[parent].inverse().compose(at), at.inverse().compose(poses[child])
    if kind == FIXED:
        return Joint(name, FIXED, parent, child, own_frame, offset=offset)
    axis = element.needed("axis")
    lower, upper = _limits(axis, kind)
    return Joint(
        name,
        CONTINUOUS if kind == REVOLUTE and math.isinf(lower) and math.isinf(upper) else kind,
        parent,
        child,
        own_frame,
        _axis(axis, at, frames, element),
        lower,
        upper,
        effort=_unless_negative(axis.number("limit/effort", -1.0)),
        velocity=_unless_negative(axis.number("limit/velocity", -1.0)),
        damping=axis.number("dynamics/damping", 0.0),
        friction=axis.number("dynamics/friction", 0.0),
        offset=offset,
    )


def _limits(axis: Element, kind: str) -> tuple[float, float]:
    limit = axis.child("limit")
    if limit is None or kind == CONTINUOUS:
        return -math.inf, math.inf
    lower, upper = limit.number("lower", -math.inf), limit.number("upper", math.inf)
    if lower > upper:
        raise limit.error(f"lower {lower:g} is above upper {upper:g}")
    return (lower if lower > -UNLIMITED else -math.inf), (upper if upper < UNLIMITED else math.inf)


def _unless_negative(value: float) -> float:
    """Returns a limit; as in SDF, a negative one is none."""
    return math.inf if value < 0 else value


def _axis(element: Element, joint: Pose, frames: Frames, owner: Element) -> Vector:
    """Returns the axis in the joint frame. SDF 1.4 gives it in the model frame, 1.5 and 1.6 optionally."""
    xyz = element.child("xyz")
    vector = (0.0, 0.0, 1.0) if xyz is None else xyz.direction()
    named = "" if xyz is None else xyz.attribute("expressed_in", "")
    of_model = (
        element.flag("use_parent_model_frame") or owner.version() == "1.4" or named == "__model__"
    )
    if named and not of_model:
        vector = rotated(frames.named(named, owner).rotation, vector)
    if named or of_model:
        return rotated(conjugate(joint.rotation), vector)
    return vector
