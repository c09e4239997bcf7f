"""Reads robots: URDF with gazebo_ros' ``<gazebo>`` elements, as on ``/robot_description``."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.element import Element, Notes
from pioneer_gazebo.world.element_table import note_unused
from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.model import (
    Box,
    Collision,
    Colour,
    Cylinder,
    Inertia,
    Link,
    Mesh,
    Shape,
    Sphere,
    Visual,
)
from pioneer_gazebo.world.plugin import Names, read_plugin
from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector
from pioneer_gazebo.world.resource import file_of_uri
from pioneer_gazebo.world.robot import Device, DiffDrive, MimicJoint, Robot
from pioneer_gazebo.world.sdf_link import GREY, RADIUS_OF_GYRATION, colour_of_material
from pioneer_gazebo.world.sensor import read_sensor

KINDS = (kinds.FIXED, kinds.CONTINUOUS, kinds.REVOLUTE, kinds.PRISMATIC, kinds.FLOATING)
_X: Vector = (1.0, 0.0, 0.0)
"""The axis of a joint that has no valid one."""
XACRO = "{http://www.ros.org/wiki/xacro}"


@dataclass(frozen=True)
class Surface:
    """The properties of a link in ``<gazebo reference=LINK>``."""

    friction: float = 1.0
    colour: Colour | None = None
    has_gravity: bool = True
    is_kinematic: bool = False


@dataclass
class Extensions:
    """Everything in a robot's ``<gazebo>`` elements."""

    surfaces: dict[str, Surface] = field(default_factory=dict)
    devices: list[Device] = field(default_factory=list)
    static: bool = False
    namespace: str = ""


def robot_from_urdf(text: str | bytes, source: str = "robot_description") -> Robot:
    """Returns the robot in URDF text (xacro expanded).

    A link without ``<inertial>`` has mass 0: it is only a frame. Friction comes from ``<gazebo reference=LINK><mu1>``.

    Args:
        text: the XML.
        source: its name in error messages.

    Raises:
        DescriptionError: the XML is malformed, a value of a link or joint is invalid, a joint refers to an unknown
            link, or the links do not form a single tree. Of plugins, sensors and shapes those that are invalid are left
            out, with a note.
    """
    notes = Notes()
    root = Element.from_text(text, source, notes)
    if root.tag != "robot":
        raise root.error("is not URDF: the root element must be <robot>")
    for child in root.children():
        if child.tag.startswith(XACRO):
            raise child.error("is xacro: expand it first (xacro FILE)")
    note_unused(root, notes)
    materials: dict[str, Colour] = {}
    for material in root.children("material"):
        with notes.leaving_out():
            materials[material.attribute("name")] = _rgba(material)
    extensions = read_extensions(root, notes)
    links = {
        link.name: link
        for link in (_link(e, materials, extensions, notes) for e in root.children("link"))
    }
    for kind in ("link", "joint"):
        _names_used_once(root, kind)
    joints = tuple(_joint(element, links, notes) for element in root.children("joint"))
    poses = _poses_in_root(root, links, joints)
    extensions.devices += _mimics(root, extensions.devices, notes)
    return Robot(
        root.attribute("name", "robot"),
        tuple(dataclasses.replace(link, pose=poses[name]) for name, link in links.items()),
        joints,
        tuple(extensions.devices),
        extensions.static,
        notes.lines(),
        extensions.namespace,
    )


def _names_used_once(root: Element, kind: str) -> None:
    seen: set[str] = set()
    for element in root.children(kind):
        name = element.attribute("name")
        if name in seen:
            raise element.error(f"a {kind} named {name!r} already exists")
        seen.add(name)


def _origin(element: Element) -> Pose:
    origin = element.child("origin")
    if origin is None:
        return IDENTITY
    position = origin.vector(origin.attribute("xyz", "0 0 0"), "xyz")
    return Pose.from_rpy(*position, *origin.vector(origin.attribute("rpy", "0 0 0"), "rpy"))


def _value(element: Element, name: str, default: float | None = None) -> float:
    text = element.attribute(name, None if default is None else repr(default))
    if default is not None and text == repr(default):
        return default
    return element.numbers(1, text, name)[0]


def _link(
    element: Element, materials: dict[str, Colour], extensions: Extensions, notes: Notes
) -> Link:
    name = element.attribute("name")
    mass, inertia = _inertial(element.child("inertial"), notes)
    surface = extensions.surfaces.get(name, Surface())
    collisions = []
    for index, child in enumerate(element.children("collision")):
        with notes.leaving_out():
            shape = _shape(child, notes)
            if shape is not None:
                label = child.attribute(
                    "name", f"{name}_collision" + (f"_{index}" if index else "")
                )
                collisions.append(Collision(label, _origin(child), shape, surface.friction))
    visuals = []
    for index, child in enumerate(element.children("visual")):
        with notes.leaving_out():
            shape = _shape(child, notes)
            if shape is not None:
                colour = surface.colour or _colour(child, materials)
                label = child.attribute("name", f"{name}_visual_{index}")
                visuals.append(Visual(label, _origin(child), shape, colour))
    return Link(
        name,
        IDENTITY,
        mass,
        inertia,
        tuple(collisions),
        tuple(visuals),
        surface.has_gravity,
        surface.is_kinematic,
    )


def _inertial(element: Element | None, notes: Notes) -> tuple[float, Inertia]:
    """Returns mass and inertia: zero if absent, as for a frame, or (with a note) for an invalid mass."""
    frame = 0.0, Inertia(0.0, 0.0, 0.0)
    if element is None:
        return frame
    mass = _value(element.needed("mass"), "value")
    moments = element.child("inertia")
    values = (
        [0.0] * 3
        if moments is None
        else [_value(moments, name, 0.0) for name in ("ixx", "iyy", "izz")]
    )
    if mass <= 0:
        element.needed("mass").note(
            notes, f"value must be > 0 (got {mass:g}); the link has no mass"
        )
        return frame
    if moments is None or min(values) <= 0:
        moment = mass * RADIUS_OF_GYRATION**2
        element.note(
            notes, f"ixx, iyy and izz must be > 0 (got {values}); {moment:g} kg m² is taken"
        )
        return mass, Inertia(moment, moment, moment, pose=_origin(element))
    ixx, iyy, izz = values
    ixy, ixz, iyz = (_value(moments, name, 0.0) for name in ("ixy", "ixz", "iyz"))
    return mass, Inertia(ixx, iyy, izz, ixy, ixz, iyz, _origin(element))


def _shape(element: Element, notes: Notes) -> Shape | None:
    """Returns the shape; None, with a note, if its mesh is not found or its size is not positive."""
    geometry = element.needed("geometry")
    inner = next(geometry.children(), None)
    if inner is None:
        raise geometry.error("is empty")
    shape: Shape | None = None
    if inner.tag == "box":
        size = inner.vector(inner.attribute("size"), "size")
        shape, least = Box(size), min(size)
    elif inner.tag == "cylinder":
        radius, length = _value(inner, "radius"), _value(inner, "length")
        shape, least = Cylinder(radius, length), min(radius, length)
    elif inner.tag == "sphere":
        least = _value(inner, "radius")
        shape = Sphere(least)
    if shape is not None:
        if least > 0:
            return shape
        inner.note(notes, f"sizes must be > 0 (got {least:g}); it is ignored")
        return None
    if inner.tag != "mesh":
        raise inner.error("is not a URDF geometry; use box, cylinder, sphere or mesh")
    path = file_of_uri(inner.attribute("filename"), Path.cwd(), ())
    if path is None:
        notes.add(f"mesh {inner.attribute('filename')} is not found and left out")
        return None
    return Mesh(str(path), inner.vector(inner.attribute("scale", "1 1 1"), "scale"))


def _rgba(material: Element) -> Colour:
    colour = material.child("color")
    if colour is None:
        return colour_of_material(material.attribute("name", "")) or GREY
    red, green, blue, alpha = colour.numbers(4, colour.attribute("rgba"), "rgba")
    return red, green, blue, alpha


def _colour(visual: Element, materials: dict[str, Colour]) -> Colour:
    material = visual.child("material")
    if material is None:
        return GREY
    named = materials.get(material.attribute("name", ""))
    return named if named is not None and material.child("color") is None else _rgba(material)


def _axis(element: Element, kind: str, notes: Notes) -> Vector:
    """Returns a joint's axis; x, with a note, for an invalid one. A joint that does not turn or slide has none."""
    axis = element.child("axis")
    if axis is None or kind in (kinds.FIXED, kinds.FLOATING):
        return _X
    try:
        return axis.direction(axis.attribute("xyz"), "xyz")
    except DescriptionError as error:
        notes.add(f"{error}; the x axis is taken")
        return _X


def _joint(element: Element, links: dict[str, Link], notes: Notes) -> Joint:
    kind = element.attribute("type")
    if kind not in KINDS:
        raise element.error(f"joint type {kind!r} is not one of {', '.join(KINDS)}")
    parent, child = (element.needed(tag).attribute("link") for tag in ("parent", "child"))
    for end in (parent, child):
        if end not in links:
            raise element.error(f"there is no link {end!r}")
    limit = element.child("limit")
    dynamics = element.child("dynamics")
    infinity = float("inf")
    bounded = kind in (kinds.REVOLUTE, kinds.PRISMATIC)
    return Joint(
        element.attribute("name"),
        kind,
        parent,
        child,
        _origin(element),
        _axis(element, kind, notes),
        lower=_value(limit, "lower", 0.0) if limit is not None and bounded else -infinity,
        upper=_value(limit, "upper", 0.0) if limit is not None and bounded else infinity,
        effort=_value(limit, "effort", infinity) if limit is not None else infinity,
        velocity=_value(limit, "velocity", infinity) if limit is not None else infinity,
        damping=_value(dynamics, "damping", 0.0) if dynamics is not None else 0.0,
        friction=_value(dynamics, "friction", 0.0) if dynamics is not None else 0.0,
    )


def _mimics(root: Element, devices: list[Device], notes: Notes) -> list[MimicJoint]:
    """Returns the joints that follow others by ``<mimic>``; those that plugins move are left to them."""
    names = _names(root)
    moved = {device.mimicJoint for device in devices if isinstance(device, MimicJoint)}
    for device in devices:
        if isinstance(device, DiffDrive):
            moved |= {joint for side in device.joints() for joint in side}
    found = []
    for element in root.children("joint"):
        name, mimic = element.attribute("name"), element.child("mimic")
        if mimic is None or name not in names.joints or name in moved:
            continue
        with notes.leaving_out():
            followed = mimic.attribute("joint")
            names.check(mimic, "joint", followed)
            if followed == name:
                raise mimic.error("a joint cannot follow itself")
            multiplier, offset = _value(mimic, "multiplier", 1.0), _value(mimic, "offset", 0.0)
            found.append(MimicJoint(name, followed, name, multiplier, offset))
    return found


def _poses_in_root(
    root: Element, links: dict[str, Link], joints: tuple[Joint, ...]
) -> dict[str, Pose]:
    """Returns each link's pose in the root link; raises if the joints do not form a single tree of all links."""
    by_child: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in by_child:
            raise root.error(
                f"link {joint.child!r} is the child of two joints, {by_child[joint.child].name!r} and {joint.name!r}"
            )
        by_child[joint.child] = joint
    roots = [name for name in links if name not in by_child]
    if len(roots) != 1:
        raise root.error(
            f"must have exactly one root link, found {len(roots)}: {', '.join(roots[:5]) or 'none'}"
        )
    poses = {roots[0]: IDENTITY}
    pending = list(joints)
    while pending:
        ready = [joint for joint in pending if joint.parent in poses]
        if not ready:
            raise root.error(
                f"joints form a loop: {', '.join(joint.name for joint in pending[:5])}"
            )
        for joint in ready:
            poses[joint.child] = poses[joint.parent].compose(joint.pose)
            pending.remove(joint)
    return poses


def read_extensions(root: Element, notes: Notes) -> Extensions:
    """Returns the content of a ``<robot>``'s ``<gazebo>`` elements.

    As in Gazebo, an element that is invalid, or that refers to an absent link or joint, is left out, with a note.
    """
    extensions = Extensions()
    names = _names(root)
    for element in root.children("gazebo"):
        reference = element.attribute("reference", "")
        if reference:
            with notes.leaving_out():
                if reference not in (*names.joints, *names.fixed):
                    names.check(element, "link", reference)
                _read_reference(element, reference, extensions, names, notes)
        else:
            _read_model(element, extensions, names, notes)
    return extensions


def _names(root: Element) -> Names:
    joints = {
        joint.attribute("name"): joint.attribute("type", kinds.FIXED)
        for joint in root.children("joint")
    }
    moving = {name for name, kind in joints.items() if kind not in (kinds.FIXED, kinds.FLOATING)}
    links = {link.attribute("name") for link in root.children("link")}
    return Names(links, moving, joints.keys() - moving)


def _read_reference(
    element: Element, link: str, extensions: Extensions, names: Names, notes: Notes
) -> None:
    surface = extensions.surfaces.get(link, Surface())
    for child in element.children():
        if child.tag == "sensor":
            with notes.leaving_out():
                names.check(child, "link", link)
                extensions.devices += read_sensor(child, link, notes)
        elif child.tag in ("mu1", "mu"):
            with notes.leaving_out():
                surface = dataclasses.replace(surface, friction=child.numbers(1, _said(child))[0])
        elif child.tag == "material":
            surface = dataclasses.replace(surface, colour=colour_of_material(_said(child)))
        elif child.tag in ("turnGravityOff", "gravity", "kinematic"):
            with notes.leaving_out():
                given = child.truth(_said(child))
                if child.tag == "kinematic":
                    surface = dataclasses.replace(surface, is_kinematic=given)
                else:
                    has_gravity = given == (child.tag == "gravity")
                    surface = dataclasses.replace(surface, has_gravity=has_gravity)
    extensions.surfaces[link] = surface


def _said(element: Element) -> str:
    """Returns an element's value: URDF parsers accept ``<mu1>1</mu1>`` and ``<mu1 value="1"/>``."""
    return element.attribute("value", element.text)


def _read_model(element: Element, extensions: Extensions, names: Names, notes: Notes) -> None:
    for child in element.children():
        if child.tag == "static":
            with notes.leaving_out():
                extensions.static = child.truth(_said(child))
        elif child.tag == "plugin":
            with notes.leaving_out():
                extensions.devices += read_plugin(child, names, notes)
            extensions.namespace = extensions.namespace or child.word("robotNamespace", "").strip(
                "/"
            )
