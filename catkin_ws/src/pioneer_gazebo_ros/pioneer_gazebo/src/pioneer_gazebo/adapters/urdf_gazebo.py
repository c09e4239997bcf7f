"""Reads URDF's ``<gazebo>`` elements: link surfaces, sensors and plugins."""

import dataclasses
from dataclasses import dataclass, field

from pioneer_gazebo.adapters.device import Names
from pioneer_gazebo.adapters.element import Element, Notes
from pioneer_gazebo.adapters.material import colour_of_material
from pioneer_gazebo.adapters.plugin import read_plugin
from pioneer_gazebo.adapters.sensor import read_sensor
from pioneer_gazebo.core.robot import Device
from pioneer_gazebo.core.world import Colour

SURFACE_QUIET = {"mu2", "kp", "kd", "fdir1", "minDepth", "maxVel", "maxContacts", "selfCollide", "laserRetro"}


@dataclass(frozen=True)
class Surface:
    """The surface properties of a link in ``<gazebo reference=LINK>``."""

    friction: float = 1.0
    colour: Colour | None = None


@dataclass
class Extensions:
    """Everything in a robot's ``<gazebo>`` elements."""

    surfaces: dict[str, Surface] = field(default_factory=dict)
    devices: list[Device] = field(default_factory=list)
    static: bool = False
    namespace: str = ""

    def surface(self, link: str) -> Surface:
        """Returns the surface of a link, or the default surface."""
        return self.surfaces.get(link, Surface())


def read_extensions(root: Element, notes: Notes) -> Extensions:
    """Returns the content of a ``<robot>``'s ``<gazebo>`` elements; adds unsupported elements to ``notes``.

    Raises:
        DescriptionError: a value is invalid, or the robot has no link or joint of a given name.
    """
    extensions = Extensions()
    names = Names(*({element.attribute("name") for element in root.children(tag)} for tag in ("link", "joint")))
    for element in root.children("gazebo"):
        reference = element.attribute("reference", "")
        if reference:
            if reference not in names.joints:
                names.check_link(element, reference)
            _read_reference(element, reference, extensions, names, notes)
        else:
            _read_model(element, extensions, names, notes)
    return extensions


def _read_reference(element: Element, link: str, extensions: Extensions, names: Names, notes: Notes) -> None:
    surface = extensions.surface(link)
    for child in element.children():
        if child.tag == "sensor":
            names.check_link(child, link)
            extensions.devices += read_sensor(child, link, notes)
        elif child.tag in ("mu1", "mu"):
            surface = dataclasses.replace(surface, friction=child.numbers(1, _said(child))[0])
        elif child.tag == "material":
            surface = dataclasses.replace(surface, colour=colour_of_material(_said(child)))
        elif child.tag not in SURFACE_QUIET:
            notes.add(f"<{child.tag}> in <gazebo reference> is not supported and ignored")
    extensions.surfaces[link] = surface


def _said(element: Element) -> str:
    """Returns an element's value: URDF parsers accept ``<mu1>1</mu1>`` and ``<mu1 value="1"/>``."""
    return element.attribute("value", element.text)


def _read_model(element: Element, extensions: Extensions, names: Names, notes: Notes) -> None:
    for child in element.children():
        if child.tag == "static":
            extensions.static = child.truth(_said(child))
        elif child.tag == "plugin":
            extensions.devices += read_plugin(child, names, notes)
            extensions.namespace = extensions.namespace or child.word("robotNamespace", "").strip("/")
        else:
            notes.add(f"<{child.tag}> in <gazebo> is not supported and ignored")
