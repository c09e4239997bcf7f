"""Reads model plugins, with the names and elements used by gazebo_ros."""

import dataclasses
import difflib
import typing
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.element import Element, Notes, library_of
from pioneer_gazebo.world.robot import (
    BaseDriver,
    Device,
    DiffDrive,
    Gps,
    GroundTruth,
    Imu,
    JointStatePublisher,
    MimicJoint,
    PlanarMove,
    RosControl,
)

Config = TypeVar("Config")

QUIET = {"alwaysOn", "always_on", "rosDebugLevel", "robotNamespace", "robotParam", "robotSimType"}
"""Plugin elements that are read elsewhere or have no effect here."""

ALIASES = {"torque": "wheelTorque", "jointNames": "jointName", "rpyOffsets": "rpyOffset"}
"""Spellings used by other releases of the plugins."""


@dataclass(frozen=True, slots=True)
class Names:
    """The link and joint names that a robot's plugins and sensors may refer to."""

    links: Collection[str]
    joints: Collection[str]  #: those that move
    fixed: Collection[str] = ()  #: joints that do not move

    def check(self, element: Element, kind: str, name: str) -> None:
        """Raises DescriptionError if the robot has no such link or moving joint (``kind``)."""
        names = {"link": self.links, "joint": self.joints}[kind]
        if kind == "joint" and name in self.fixed:
            raise element.error(f"joint {name!r} is fixed")
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            raise element.error(
                f"unknown {kind} {name!r}" + (f"; did you mean {near[0]!r}?" if near else "")
            )


def note_unread(plugin: Element, read: Collection[str], notes: Notes) -> None:
    """Adds a note for every element of a plugin that is not in ``read``."""
    for child in plugin.children():
        if child.tag not in QUIET and child.tag not in read:
            notes.add(
                f"<{child.tag}> of plugin lib{library_of(plugin)}.so is not supported and ignored"
            )


def filled(
    config: type[Config], element: Element, notes: Notes, known: Collection[str] = (), **given: Any
) -> Config:
    """Returns a ``config`` filled from the plugin's name, the child elements named like its fields, and ``given``.

    Args:
        config: the class.
        element: the plugin.
        notes: receives a note for each child that is neither a field nor in ``known``.
        known: tags that the caller reads, or that have no effect.
        **given: further fields.

    Raises:
        DescriptionError: a value is invalid.
    """
    hints = typing.get_type_hints(config)
    given["name"] = element.attribute("name", library_of(element))
    for child in element.children():
        tag = ALIASES.get(child.tag, child.tag)
        if tag in hints and hints[tag] in _READERS:
            given[tag] = _READERS[hints[tag]](child)
        elif tag not in QUIET and tag not in known:
            near = difflib.get_close_matches(tag, hints, n=1)
            hint = f"; did you mean <{near[0]}>?" if near else ""
            notes.add(
                f"<{tag}> of plugin lib{library_of(element)}.so is not supported and ignored{hint}"
            )
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


SIDES = ("left", "right")


def read_plugin(element: Element, names: Names, notes: Notes) -> list[Device]:
    """Returns the device of a ``<plugin>``; empty, with a note, if it is not supported.

    Raises:
        DescriptionError: a value is invalid, or the robot has no link or joint of a given name.
    """
    library = library_of(element)
    reader = _PLUGINS.get(library)
    if reader is None:
        notes.add(f"plugin lib{library}.so is not supported and ignored")
        return []
    found = reader(element, names, notes)
    return in_own_namespace(element, found if isinstance(found, list) else [found])


def in_own_namespace(plugin: Element, devices: list[Device]) -> list[Device]:
    """Returns a plugin's devices with its own namespace, if it gives one; ``/`` is the root namespace."""
    text = plugin.word("robotNamespace", "")
    if not text:
        return devices
    return [dataclasses.replace(device, namespace=text.strip("/")) for device in devices]


def _plain(
    kind: type[Any], element: Element, names: Names, notes: Notes, known: Collection[str] = ()
) -> Any:
    """Reads a plugin whose elements are the fields of ``kind``; checks the link and joints that it names."""
    if "bodyName" in kind.__dataclass_fields__:
        names.check(element, "link", element.needed("bodyName").text)
    device = filled(kind, element, notes, known)
    if isinstance(device, JointStatePublisher):
        return _with_known_joints(device, element, names, notes)
    return device


def _with_known_joints(
    device: JointStatePublisher, element: Element, names: Names, notes: Notes
) -> JointStatePublisher:
    """Returns the publisher of those joints that the robot has.

    Raises:
        DescriptionError: it has none of them.
    """
    known = []
    for joint in device.jointName:
        try:
            names.check(element, "joint", joint)
        except DescriptionError as error:
            if device.jointName == (joint,):
                raise
            notes.add(f"{error}; it is left out")
        else:
            known.append(joint)
    if device.jointName and not known:
        raise element.error("the robot has none of the joints in jointName")
    return dataclasses.replace(device, jointName=tuple(known))


def _drive(element: Element, names: Names, notes: Notes) -> DiffDrive:
    return _checked_drive(element, names, filled(DiffDrive, element, notes))


_SKID_COVARIANCE = {"x": 0.0001, "y": 0.0001, "yaw": 0.01}
"""The defaults of gazebo_ros' skid steer drive."""


def _skid_steer(element: Element, names: Names, notes: Notes) -> DiffDrive:
    """Reads a four-wheel skid-steer drive; as in gazebo_ros, its odometry is the true pose."""
    joints: dict[str, Any] = {
        f"{side}Joint": element.word(f"{side}FrontJoint", f"{side}FrontJoint") for side in SIDES
    }
    joints |= {f"{side}RearJoint": (f"{side}RearJoint",) for side in SIDES}
    variances = [
        element.number(f"covariance_{axis}", default) for axis, default in _SKID_COVARIANCE.items()
    ]
    x, y, yaw = variances
    covariance = (x, y, 1e12, 1e12, 1e12, yaw)
    known = {
        "leftFrontJoint",
        "rightFrontJoint",
        "broadcastTF",
        "covariance_x",
        "covariance_y",
        "covariance_yaw",
    }
    drive = filled(DiffDrive, element, notes, known, **joints)
    drive = dataclasses.replace(
        drive,
        publishOdomTF=element.flag("broadcastTF", True),
        odometrySource="world",
        poseCovariance=covariance,
        twistCovariance=covariance,
    )
    return _checked_drive(element, names, drive)


_KOBUKI_PREFIX = "mobile_base"
"""Namespace of a Kobuki's own topics, its plugin's default."""
_KOBUKI_BASE = "base_footprint"
"""The link that a Kobuki's plugin moves, and that carries its IMU."""


def _kobuki(element: Element, names: Names, notes: Notes) -> list[Device]:
    """Reads the plugin of a Kobuki, the base of a TurtleBot 2: a drive and an IMU with fixed topics and frames.

    Topics and frames may also be given as for ``libgazebo_ros_diff_drive.so``, which the plugin itself cannot.
    """
    joints: dict[str, Any] = {
        f"{side}Joint": element.needed(f"{side}_wheel_joint_name").text for side in SIDES
    }
    sizes = {
        "wheelSeparation": element.needed("wheel_separation").numbers(1)[0],
        "wheelDiameter": element.needed("wheel_diameter").numbers(1)[0],
        "commandTimeout": element.number("velocity_command_timeout", 0.0),
    }
    known = {
        "left_wheel_joint_name",
        "right_wheel_joint_name",
        "wheel_separation",
        "wheel_diameter",
        "velocity_command_timeout",
        "publish_tf",
        "imu_name",
    }
    drive = filled(DiffDrive, element, notes, known, **joints, **sizes)
    drive = dataclasses.replace(
        drive,
        commandTopic=element.word("commandTopic", f"{_KOBUKI_PREFIX}/commands/velocity"),
        odometrySource="encoder",
        publishTf=element.flag("publish_tf", False),
        publishWheelJointState=True,
    )
    devices: list[Device] = [_checked_drive(element, names, drive)]
    if element.child("imu_name") is not None and _KOBUKI_BASE in names.links:
        topic = f"{_KOBUKI_PREFIX}/sensors/imu_data"
        devices.append(Imu(element.word("imu_name", "imu"), _KOBUKI_BASE, topic, "base_link"))
    return devices


def _force_based_move(element: Element, names: Names, notes: Notes) -> PlanarMove:
    """Reads a base that forces move as commanded; here it moves as commanded at once, so gains have no effect."""
    del names
    is_published = element.flag("publishOdometryTf", True)
    return filled(PlanarMove, element, notes, {"publishOdometryTf"}, publishTf=is_published)


def _mimic(element: Element, names: Names, notes: Notes) -> MimicJoint:
    mimic: MimicJoint = filled(MimicJoint, element, notes, _MIMIC_QUIET)
    names.check(element, "joint", mimic.joint)
    names.check(element, "joint", mimic.mimicJoint)
    if mimic.joint == mimic.mimicJoint:
        raise element.error("a joint cannot follow itself")
    return mimic


_MIMIC_QUIET = ("hasPID", "maxEffort", "sensitiveness")
"""Elements of mimic joint plugins about how hard a joint follows, which it does exactly here."""


def _checked_drive(element: Element, names: Names, drive: DiffDrive) -> DiffDrive:
    for side in drive.joints():
        for joint in side:
            names.check(element, "joint", joint)
    if drive.legacyMode not in ("", "true", "false"):
        drive = dataclasses.replace(drive, legacyMode=str(element.flag("legacyMode")).lower())
    _check_positive(element, drive, "wheelSeparation", "wheelDiameter", "wheelTorque")
    if drive.commandTimeout < 0:
        raise element.error(f"commandTimeout must be >= 0 (got {drive.commandTimeout:g})")
    source = {"0": "encoder", "1": "world"}.get(drive.odometrySource, drive.odometrySource)
    if source not in ("encoder", "world"):
        raise element.error(f"odometrySource must be encoder or world, not {source!r}")
    return dataclasses.replace(drive, odometrySource=source)


def _check_positive(element: Element, device: Device, *names: str) -> None:
    for name in names:
        if getattr(device, name) <= 0:
            raise element.error(f"{name} must be above 0, not {getattr(device, name):g}")


def _base_driver(element: Element, names: Names, notes: Notes) -> BaseDriver:
    del names
    base = filled(BaseDriver, element, notes)
    _check_positive(
        element, base, "updateRate", "capacity", "emptyVoltage", "resistance", "driveEfficiency"
    )
    for name in ("idlePower", "rollingResistance", "windingLoss", "initialCharge"):
        if getattr(base, name) < 0:
            raise element.error(f"{name} must not be below 0, not {getattr(base, name):g}")
    if base.fullVoltage < base.emptyVoltage or base.initialCharge > 1 or base.driveEfficiency > 1:
        raise element.error(
            "fullVoltage must be emptyVoltage or more, initialCharge and driveEfficiency at most 1"
        )
    return base


def _truth(element: Element, names: Names, notes: Notes) -> GroundTruth:
    truth: GroundTruth = _plain(GroundTruth, element, names, notes)
    if truth.frameName.lstrip("/") not in ("map", "world", *names.links):
        element.note(
            notes,
            f"frameName {truth.frameName!r} is no link of the robot: poses in that frame are those in the world",
        )
    return truth


def _imu(element: Element, names: Names, notes: Notes) -> Imu:
    return imu_of(element, element.needed("bodyName").text, names, notes)


def imu_of(element: Element, link: str, names: Names | None, notes: Notes) -> Imu:
    """Returns the IMU of a plugin, either of a model or of a sensor on ``link``."""
    if names is not None:
        names.check(element, "link", link)
    frame = element.word("frameName", element.word("frameId", link))
    rate = element.number("updateRateHZ", element.number("updateRate", 0.0))
    given = {"bodyName": link, "frame": frame, "updateRate": rate}
    known = {"frameName", "frameId", "updateRateHZ", "serviceName"}
    return dataclasses.replace(
        filled(Imu, element, notes, known, **given), bodyName=link, updateRate=rate
    )


_PLUGINS: dict[str, Callable[[Element, Names, Notes], Device | list[Device]]] = {
    "gazebo_ros_diff_drive": _drive,
    "gazebo_ros_skid_steer_drive": _skid_steer,
    "gazebo_ros_planar_move": partial(_plain, PlanarMove),
    "gazebo_ros_force_based_move": _force_based_move,
    "gazebo_ros_kobuki": _kobuki,
    "gazebo_ros_control": partial(
        _plain, RosControl, known={"controlPeriod", "robotSimType", "legacyModeNS"}
    ),
    "gazebo_ros_imu": _imu,
    "hector_gazebo_ros_imu": _imu,
    "hector_gazebo_ros_gps": partial(_plain, Gps),
    "gazebo_ros_p3d": _truth,
    "gazebo_ros_joint_state_publisher": partial(_plain, JointStatePublisher),
    "roboticsgroup_gazebo_mimic_joint_plugin": _mimic,
    "roboticsgroup_upatras_gazebo_mimic_joint_plugin": _mimic,
    "gazebo_mimic_joint_plugin": _mimic,
    "pioneer_base_driver": _base_driver,
}
