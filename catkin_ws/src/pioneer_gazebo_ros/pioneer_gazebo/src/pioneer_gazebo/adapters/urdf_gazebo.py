"""The ``<gazebo>`` elements of URDF: surfaces, and sensors and plugins under the names gazebo_ros gives them."""

import dataclasses
import difflib
import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pioneer_gazebo.adapters.element import Element, Notes
from pioneer_gazebo.adapters.material import colour_of_material
from pioneer_gazebo.core.pose import IDENTITY, Pose
from pioneer_gazebo.core.robot import (
    BaseDriver,
    Bumper,
    Camera,
    DiffDrive,
    GroundTruth,
    JointStatePublisher,
    LaserSensor,
    SonarSensor,
)
from pioneer_gazebo.core.world import Colour

Config = TypeVar("Config")

SURFACE_QUIET = {"mu2", "kp", "kd", "fdir1", "minDepth", "maxVel", "maxContacts", "selfCollide", "laserRetro"}
SENSOR_QUIET = {"pose", "ray", "camera", "contact", "plugin", "update_rate", "visualize", "always_on", "topic"}
PLUGIN_QUIET = {"alwaysOn", "always_on", "rosDebugLevel", "legacyMode", "robotNamespace", "hackBaseline"}
# Spellings of other releases of the plugins.
ALIASES = {"torque": "wheelTorque", "jointNames": "jointName"}
DRIVE_PLUGIN = "gazebo_ros_diff_drive"
GROUND_TRUTH_PLUGIN = "gazebo_ros_p3d"
BASE_DRIVER_PLUGIN = "pioneer_base_driver"
JOINT_STATE_PLUGIN = "gazebo_ros_joint_state_publisher"
LASER_PLUGINS = ("gazebo_ros_laser", "gazebo_ros_gpu_laser")
RANGE_PLUGIN = "gazebo_ros_range"
CAMERA_PLUGIN = "gazebo_ros_camera"
PIXEL_FORMATS = ("R8G8B8", "B8G8R8", "L8", "RGB_INT8", "BGR_INT8", "L_INT8")
BUMPER_PLUGIN = "gazebo_ros_bumper"


@dataclass(frozen=True)
class Surface:
    """What ``<gazebo reference=LINK>`` says of a link's surface."""

    friction: float = 1.0
    colour: Colour | None = None


@dataclass
class Extensions:
    """Everything in a robot's ``<gazebo>`` elements."""

    surfaces: dict[str, Surface] = field(default_factory=dict)
    drives: list[DiffDrive] = field(default_factory=list)
    lasers: list[LaserSensor] = field(default_factory=list)
    sonars: list[SonarSensor] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    ground_truths: list[GroundTruth] = field(default_factory=list)
    bumpers: list[Bumper] = field(default_factory=list)
    joint_state_publishers: list[JointStatePublisher] = field(default_factory=list)
    base_drivers: list[BaseDriver] = field(default_factory=list)
    static: bool = False

    def surface(self, link: str) -> Surface:
        """Returns the surface of a link, the default one where nothing is said."""
        return self.surfaces.get(link, Surface())

    def check(self, root: Element, links: set[str], joints: set[str]) -> None:
        """Raises DescriptionError when a plugin or sensor names a link or joint that the robot has not."""
        for drive in self.drives:
            for name in (drive.leftJoint, drive.rightJoint):
                _known(root, f"plugin {drive.name!r}", "joint", name, joints)
        for publisher in self.joint_state_publishers:
            for name in publisher.jointName:
                _known(root, f"plugin {publisher.name!r}", "joint", name, joints)
        for truth in self.ground_truths:
            _known(root, f"plugin {truth.name!r}", "link", truth.bodyName, links)
        sensors: tuple[Any, ...] = (*self.lasers, *self.sonars, *self.cameras, *self.bumpers)
        for sensor in sensors:
            _known(root, f"sensor {sensor.name!r}", "link", sensor.link, links)
        for link in self.surfaces:
            _known(root, "<gazebo reference>", "link or joint", link, links | joints)


def _known(root: Element, who: str, what: str, name: str, names: set[str]) -> None:
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        raise root.error(f"{who} names {what} {name!r}, which is not there" + (f"; is it {near[0]!r}?" if near else ""))


def read_extensions(root: Element, notes: Notes) -> Extensions:
    """Returns what all ``<gazebo>`` elements of a ``<robot>`` say; unsupported elements go into ``notes``.

    Raises:
        DescriptionError: a value that makes no sense.
    """
    extensions = Extensions()
    for element in root.children("gazebo"):
        reference = element.attribute("reference", "")
        if reference:
            _read_reference(element, reference, extensions, notes)
        else:
            _read_model(element, extensions, notes)
    return extensions


def _read_reference(element: Element, link: str, extensions: Extensions, notes: Notes) -> None:
    surface = extensions.surface(link)
    for child in element.children():
        if child.tag == "sensor":
            _read_sensor(child, link, extensions, notes)
        elif child.tag in ("mu1", "mu"):
            surface = dataclasses.replace(surface, friction=child.numbers(1)[0])
        elif child.tag == "material":
            surface = dataclasses.replace(surface, colour=colour_of_material(child.text))
        elif child.tag not in SURFACE_QUIET:
            notes.add(f"<{child.tag}> in <gazebo reference> is not supported and left out")
    extensions.surfaces[link] = surface


def _read_model(element: Element, extensions: Extensions, notes: Notes) -> None:
    for child in element.children():
        if child.tag == "static":
            extensions.static = child.truth()
        elif child.tag == "plugin":
            _read_plugin(child, extensions, notes)
        else:
            notes.add(f"<{child.tag}> in <gazebo> is not supported and left out")


def _plugin(element: Element) -> str:
    """Returns the library's name without ``lib`` and ``.so``."""
    return element.attribute("filename").rpartition("/")[2].removeprefix("lib").removesuffix(".so")


def _read_plugin(element: Element, extensions: Extensions, notes: Notes) -> None:
    library = _plugin(element)
    name = element.attribute("name", library)
    if library == DRIVE_PLUGIN:
        extensions.drives.append(_checked_drive(element, _filled(DiffDrive, element, notes, name=name)))
    elif library == GROUND_TRUTH_PLUGIN:
        element.needed("bodyName")
        extensions.ground_truths.append(_filled(GroundTruth, element, notes, name=name))
    elif library == JOINT_STATE_PLUGIN:
        extensions.joint_state_publishers.append(_filled(JointStatePublisher, element, notes, name=name))
    elif library == BASE_DRIVER_PLUGIN:
        extensions.base_drivers.append(_checked_base(element, _filled(BaseDriver, element, notes, name=name)))
    else:
        notes.add(f"plugin lib{library}.so is not supported and left out")


def _checked_drive(element: Element, drive: DiffDrive) -> DiffDrive:
    for name in ("wheelSeparation", "wheelDiameter", "wheelTorque"):
        if getattr(drive, name) <= 0:
            raise element.error(f"{name} must be above 0, not {getattr(drive, name):g}")
    if drive.commandTimeout < 0:
        raise element.error(f"commandTimeout must be 0 or more, not {drive.commandTimeout:g}")
    source = {"0": "encoder", "1": "world"}.get(drive.odometrySource, drive.odometrySource)
    if source not in ("encoder", "world"):
        raise element.error(f"odometrySource must be encoder or world, not {source!r}")
    return dataclasses.replace(drive, odometrySource=source)


def _checked_base(element: Element, base: BaseDriver) -> BaseDriver:
    for name in ("updateRate", "capacity", "emptyVoltage", "resistance", "driveEfficiency"):
        if getattr(base, name) <= 0:
            raise element.error(f"{name} must be above 0, not {getattr(base, name):g}")
    for name in ("idlePower", "rollingResistance", "windingLoss", "initialCharge"):
        if getattr(base, name) < 0:
            raise element.error(f"{name} must not be below 0, not {getattr(base, name):g}")
    if base.fullVoltage < base.emptyVoltage or base.initialCharge > 1 or base.driveEfficiency > 1:
        raise element.error("fullVoltage must be emptyVoltage or more, initialCharge and driveEfficiency at most 1")
    return base


def _filled(config: type[Config], element: Element, notes: Notes, **given: Any) -> Config:
    """Returns ``config`` with every field whose name is a child's tag filled from that child, and ``given``."""
    hints = typing.get_type_hints(config)
    for child in element.children():
        tag = ALIASES.get(child.tag, child.tag)
        if tag in hints:
            given[tag] = _READERS[hints[tag]](child)
        elif tag not in PLUGIN_QUIET:
            near = difflib.get_close_matches(tag, hints, n=1)
            hint = f"; is <{near[0]}> meant?" if near else ""
            notes.add(f"<{tag}> of plugin lib{_plugin(element)}.so is not supported and left out{hint}")
    if "robotNamespace" in hints:
        given["robotNamespace"] = element.word("robotNamespace", "").strip("/")
    return config(**given)


def _read_names(element: Element) -> tuple[str, ...]:
    return tuple(element.text.replace(",", " ").split())


_READERS: dict[Any, Callable[[Element], Any]] = {
    str: lambda element: element.text,
    float: lambda element: element.numbers(1)[0],
    int: lambda element: int(element.numbers(1)[0]),
    bool: Element.truth,
    tuple[str, ...]: _read_names,
    tuple[float, float, float]: Element.vector,
}


def _read_sensor(element: Element, link: str, extensions: Extensions, notes: Notes) -> None:
    for child in element.children():
        if child.tag not in SENSOR_QUIET:
            notes.add(f"<{child.tag}> in <sensor> is not supported and left out")
    plugin = element.child("plugin")
    library = "" if plugin is None else _plugin(plugin)
    if plugin is None:
        notes.add(f"sensor {element.attribute('name')!r} has no plugin that would publish it and is left out")
    elif library in LASER_PLUGINS:
        extensions.lasers.append(_laser(element, plugin, link))
    elif library == RANGE_PLUGIN:
        extensions.sonars.append(_sonar(element, plugin, link))
    elif library == CAMERA_PLUGIN:
        extensions.cameras.append(_camera(element, plugin, link))
    elif library == BUMPER_PLUGIN:
        extensions.bumpers.append(_bumper(element, plugin, link))
    else:
        notes.add(f"sensor plugin lib{library}.so is not supported and left out")


def _common(element: Element, link: str) -> dict[str, Any]:
    pose = element.child("pose")
    rate = element.number("update_rate", 0.0)
    if rate < 0:
        raise element.needed("update_rate").error("must not be below 0")
    return {
        "name": element.attribute("name"),
        "link": link,
        "pose": IDENTITY if pose is None or not pose.text else pose.pose(),
        "update_rate": rate,
    }


def _ray(element: Element) -> tuple[Element, Element, dict[str, Any]]:
    """Returns ``<horizontal>``, ``<range>`` and the settings every ray sensor shares."""
    ray = element.needed("ray")
    horizontal = ray.needed("scan").needed("horizontal")
    reach = ray.needed("range")
    near, far = reach.number("min"), reach.positive("max")
    if not 0 <= near < far:
        raise reach.error(f"min must be between 0 and max, not {near:g} with max {far:g}")
    samples = horizontal.integer("samples")
    if samples < 1:
        raise horizontal.needed("samples").error(f"must be 1 or more, not {samples}")
    return horizontal, reach, {"samples": samples, "min_range": near, "max_range": far}


def _laser(element: Element, plugin: Element, link: str) -> LaserSensor:
    horizontal, reach, shared = _ray(element)
    noise = element.needed("ray").child("noise")
    lowest, highest = horizontal.number("min_angle"), horizontal.number("max_angle")
    if lowest > highest:
        raise horizontal.error(f"min_angle {lowest:g} is above max_angle {highest:g}")
    return LaserSensor(
        **_common(element, link),
        **shared,
        min_angle=lowest,
        max_angle=highest,
        resolution=reach.number("resolution", 0.0),
        noise_mean=0.0 if noise is None else noise.number("mean", 0.0),
        noise_stddev=0.0 if noise is None else noise.number("stddev", 0.0),
        topic=plugin.word("topicName", "base_scan"),
        frame=plugin.word("frameName", link),
    )


def _sonar(element: Element, plugin: Element, link: str) -> SonarSensor:
    horizontal, _, shared = _ray(element)
    common = _common(element, link)
    common["update_rate"] = plugin.number("updateRate", common["update_rate"])
    opening = horizontal.number("max_angle") - horizontal.number("min_angle")
    return SonarSensor(
        **common,
        **shared,
        fov=plugin.number("fov", opening),
        radiation=plugin.word("radiation", "ultrasound"),
        gaussianNoise=plugin.number("gaussianNoise", 0.0),
        topic=plugin.word("topicName", "sonar"),
        frame=plugin.word("frameName", link),
    )


def _camera(element: Element, plugin: Element, link: str) -> Camera:
    camera = element.needed("camera")
    image = camera.needed("image")
    common = _common(element, link)
    width, height = image.integer("width"), image.integer("height")
    if min(width, height) < 1:
        raise image.error(f"width and height must be 1 or more, not {width} and {height}")
    clip, noise = camera.child("clip"), camera.child("noise")
    pixels = image.word("format", "R8G8B8")
    if pixels not in PIXEL_FORMATS:
        raise image.needed("format").error(f"must be one of {', '.join(PIXEL_FORMATS)}, not {pixels!r}")
    return Camera(
        name=plugin.word("cameraName", common["name"]),
        link=link,
        pose=_camera_pose(common["pose"], camera),
        update_rate=plugin.number("updateRate", 0.0) or common["update_rate"],
        horizontal_fov=camera.positive("horizontal_fov", 1.047),
        width=width,
        height=height,
        near=0.1 if clip is None else clip.positive("near", 0.1),
        far=100.0 if clip is None else clip.positive("far", 100.0),
        format=pixels,
        noise_stddev=0.0 if noise is None else noise.number("stddev", 0.0),
        image_topic=plugin.word("imageTopicName", "image_raw"),
        info_topic=plugin.word("cameraInfoTopicName", "camera_info"),
        frame=plugin.word("frameName", link),
    )


def _camera_pose(sensor: Pose, camera: Element) -> Pose:
    pose = camera.child("pose")
    return sensor if pose is None or not pose.text else sensor.compose(pose.pose())


def _bumper(element: Element, plugin: Element, link: str) -> Bumper:
    common = _common(element, link)
    contact = element.child("contact")
    return Bumper(
        name=common["name"],
        link=link,
        collision="" if contact is None else contact.word("collision", ""),
        bumperTopicName=plugin.word("bumperTopicName", "bumper"),
        frameName=plugin.word("frameName", "map"),
        update_rate=common["update_rate"],
    )
