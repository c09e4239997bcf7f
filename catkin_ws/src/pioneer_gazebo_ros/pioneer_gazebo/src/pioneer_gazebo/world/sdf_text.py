"""Writes worlds as SDF 1.6 for Gazebo and this package."""

from xml.sax.saxutils import quoteattr

from pioneer_gazebo.world.model import (
    Box,
    Colour,
    Cylinder,
    Link,
    Mesh,
    Model,
    Plane,
    Shape,
    Sphere,
    World,
)
from pioneer_gazebo.world.pose import IDENTITY, Pose

_HEAD = """<?xml version="1.0"?>
<sdf version="1.6">
  <world name={name}>
    <include><uri>model://sun</uri></include>
    <include><uri>model://ground_plane</uri></include>
"""


def sdf_from_world(world: World) -> str:
    """Returns the world as SDF text: sun, ground plane, and every other model of the world.

    Masses and inertias are not written, as it is meant for worlds of static models.
    """
    models = "".join(_model(model) for model in world.models if model.name != "ground_plane")
    return _HEAD.format(name=quoteattr(world.name)) + models + "  </world>\n</sdf>\n"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _pose(pose: Pose) -> str:
    return "" if pose == IDENTITY else f"<pose>{_numbers(*pose.position, *pose.rpy())}</pose>"


def _model(model: Model) -> str:
    links = "".join(_link(link) for link in model.links)
    static = "true" if model.static else "false"
    head = f"    <model name={quoteattr(model.name)}>\n      <static>{static}</static>{_pose(model.pose)}\n"
    return f"{head}{links}    </model>\n"


def _link(link: Link) -> str:
    lines = [f"      <link name={quoteattr(link.name)}>{_pose(link.pose)}"]
    for collision in link.collisions:
        name = quoteattr(collision.name)
        lines.append(
            f"        <collision name={name}>{_pose(collision.pose)}{_geometry(collision.shape)}</collision>"
        )
    for visual in link.visuals:
        body = _pose(visual.pose) + _geometry(visual.shape) + _material(visual.colour)
        lines.append(f"        <visual name={quoteattr(visual.name)}>{body}</visual>")
    return "\n".join(lines) + "\n      </link>\n"


def _material(colour: Colour) -> str:
    return f"<material><ambient>{_numbers(*colour)}</ambient><diffuse>{_numbers(*colour)}</diffuse></material>"


def _geometry(shape: Shape) -> str:
    return f"<geometry>{_shape(shape)}</geometry>"


def _shape(shape: Shape) -> str:
    match shape:
        case Box(size=size):
            return f"<box><size>{_numbers(*size)}</size></box>"
        case Cylinder(radius=radius, length=length):
            return f"<cylinder><radius>{_numbers(radius)}</radius><length>{_numbers(length)}</length></cylinder>"
        case Sphere(radius=radius):
            return f"<sphere><radius>{_numbers(radius)}</radius></sphere>"
        case Plane(normal=normal, size=size):
            return (
                f"<plane><normal>{_numbers(*normal)}</normal><size>{_numbers(*size)}</size></plane>"
            )
        case Mesh(path=""):
            raise ValueError("a mesh that is in no file cannot be written as SDF")
        case Mesh(path=path, scale=scale):
            return f"<mesh><uri>file://{path}</uri><scale>{_numbers(*scale)}</scale></mesh>"
