"""Reads SDF links: inertia, collisions, visuals and their geometry."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pioneer_gazebo.adapters.element import Element, Notes
from pioneer_gazebo.adapters.resource import file_of_uri
from pioneer_gazebo.core.error import DescriptionError
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.world import (
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


QUIET = {
    "pose",
    "self_collide",
    "enable_wind",
    "kinematic",
    "velocity_decay",
    "must_be_base_link",
    "gravity",
    "light",
    "sensor",
}

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
            self.notes.ignored(error)


def link_from_sdf(element: Element, pose: Pose, scope: Scope) -> Link:
    """Returns the link of a ``<link>`` element.

    Args:
        element: the ``<link>``.
        pose: of the link in the model, resolved by the caller.
        scope: of the file.
    """
    mass, inertia = _inertial(element.child("inertial"), scope.notes)
    _note_foreign_frames(element, scope)
    collisions = []
    visuals = []
    for child in element.children():
        if child.tag == "collision":
            with scope.leaving_out():
                shape = _shape(child, scope)
                if shape is not None:
                    collisions.append(_collision(child, shape))
        elif child.tag == "visual":
            with scope.leaving_out():
                shape = _shape(child, scope)
                if shape is not None:
                    visuals.append(Visual(child.attribute("name", "visual"), child.placed(), shape, _colour(child)))
        elif child.tag not in QUIET | {"inertial"}:
            scope.notes.add(f"<{child.tag}> in a world's link is not supported and left out")
    return Link(element.attribute("name"), pose, mass, inertia, tuple(collisions), tuple(visuals))


def _note_foreign_frames(link: Element, scope: Scope) -> None:
    """Adds a note for each pose of a shape in a frame other than the link's."""
    for child in link.children("collision", "visual", "inertial"):
        pose = child.child("pose")
        frame = "" if pose is None else pose.attribute("relative_to", pose.attribute("frame", ""))
        if frame not in ("", link.attribute("name", "")):
            scope.notes.add(f"the frame of a <pose> in <{child.tag}> is not supported: the link's is taken")


def _inertial(element: Element | None, notes: Notes) -> tuple[float, Inertia]:
    """Returns mass and inertia; physically impossible values are replaced by defaults, with a note."""
    if element is None:
        return 1.0, Inertia()
    pose = element.placed()
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
        moments.note(notes, f"ixx, iyy, izz must be > 0 (got {ixx:g}, {iyy:g}, {izz:g}); {moment:g} kg m² is taken")
        return mass, Inertia(moment, moment, moment, pose=pose)
    ixy, ixz, iyz = (moments.number(tag, 0.0) for tag in ("ixy", "ixz", "iyz"))
    return mass, Inertia(ixx, iyy, izz, ixy, ixz, iyz, pose)


def _collision(element: Element, shape: Shape) -> Collision:
    return Collision(
        element.attribute("name", "collision"),
        element.placed(),
        shape,
        friction=element.number("surface/friction/ode/mu", 1.0),
        restitution=element.number("surface/bounce/restitution_coefficient", 0.0),
    )


def _shape(element: Element, scope: Scope) -> Shape | None:
    """Returns the shape in ``<geometry>``; None for an empty one or, with a note, an unsupported one."""
    geometry = element.needed("geometry")
    inner = next(geometry.children(), None)
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
        return _plane(inner)
    if inner.tag == "mesh":
        return _mesh(inner, scope)
    scope.notes.add(f"geometry <{inner.tag}> is not supported and left out")
    return None


def _plane(element: Element) -> Plane:
    normal, size = element.child("normal"), element.child("size")
    width, depth = (100.0, 100.0) if size is None else size.numbers(2)
    return Plane((0.0, 0.0, 1.0) if normal is None else normal.direction(), (width, depth))


def _mesh(element: Element, scope: Scope) -> Mesh | None:
    uri = element.needed("uri")
    if element.child("submesh") is not None:
        scope.notes.add(f"<submesh> of {uri.text} is not supported: the whole mesh is taken")
    scale = element.child("scale")
    path = file_of_uri(uri.text, scope.directory, scope.models)
    if path is None:
        scope.notes.add(f"mesh {uri.text} is not found and left out")
        return None
    return Mesh(str(path), (1.0, 1.0, 1.0) if scale is None else scale.vector())


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
