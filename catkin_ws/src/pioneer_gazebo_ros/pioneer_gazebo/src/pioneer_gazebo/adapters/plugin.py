"""Reads model plugins, with the names and elements used by gazebo_ros."""

import dataclasses
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from pioneer_gazebo.adapters.device import Names, filled, library_of
from pioneer_gazebo.adapters.element import Element, Notes
from pioneer_gazebo.core.device import Gps, Imu, PlanarMove, RosControl
from pioneer_gazebo.core.robot import BaseDriver, Device, DiffDrive, GroundTruth, JointStatePublisher

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
    return [reader(element, names, notes)]


def _name(element: Element) -> str:
    return element.attribute("name", library_of(element))


def _plain(kind: type[Any], element: Element, names: Names, notes: Notes, known: Collection[str] = ()) -> Any:
    """Reads a plugin whose elements are the fields of ``kind``; checks the link and joints that it names."""
    if "bodyName" in kind.__dataclass_fields__:
        names.check_link(element, element.needed("bodyName").text)
    device = filled(kind, element, notes, known, name=_name(element))
    for joint in getattr(device, "jointName", ()):
        names.check_joint(element, joint)
    return device


def _drive(element: Element, names: Names, notes: Notes) -> DiffDrive:
    return _checked_drive(element, names, filled(DiffDrive, element, notes, name=_name(element)))


def _skid_steer(element: Element, names: Names, notes: Notes) -> DiffDrive:
    """Reads a four-wheel skid-steer drive; as in gazebo_ros, its odometry is the true pose."""
    joints: dict[str, Any] = {f"{side}Joint": element.word(f"{side}FrontJoint", f"{side}FrontJoint") for side in SIDES}
    joints |= {f"{side}RearJoint": (f"{side}RearJoint",) for side in SIDES}
    known = {"leftFrontJoint", "rightFrontJoint", "broadcastTF", "covariance_x", "covariance_y", "covariance_yaw"}
    drive = filled(DiffDrive, element, notes, known, name=_name(element), **joints)
    drive = dataclasses.replace(drive, publishOdomTF=element.flag("broadcastTF", True), odometrySource="world")
    return _checked_drive(element, names, drive)


def _checked_drive(element: Element, names: Names, drive: DiffDrive) -> DiffDrive:
    for side in drive.joints():
        for joint in side:
            names.check_joint(element, joint)
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
    base = filled(BaseDriver, element, notes, name=_name(element))
    _check_positive(element, base, "updateRate", "capacity", "emptyVoltage", "resistance", "driveEfficiency")
    for name in ("idlePower", "rollingResistance", "windingLoss", "initialCharge"):
        if getattr(base, name) < 0:
            raise element.error(f"{name} must not be below 0, not {getattr(base, name):g}")
    if base.fullVoltage < base.emptyVoltage or base.initialCharge > 1 or base.driveEfficiency > 1:
        raise element.error("fullVoltage must be emptyVoltage or more, initialCharge and driveEfficiency at most 1")
    return base


def _imu(element: Element, names: Names, notes: Notes) -> Imu:
    return imu_of(element, element.needed("bodyName").text, names, notes)


def imu_of(element: Element, link: str, names: Names | None, notes: Notes) -> Imu:
    """Returns the IMU of a plugin, either of a model or of a sensor on ``link``."""
    if names is not None:
        names.check_link(element, link)
    frame = element.word("frameName", element.word("frameId", link))
    rate = element.number("updateRateHZ", element.number("updateRate", 0.0))
    given = {"bodyName": link, "frame": frame, "updateRate": rate, "name": _name(element)}
    known = {"frameName", "frameId", "updateRateHZ", "serviceName", "initialOrientationAsReference"}
    return dataclasses.replace(filled(Imu, element, notes, known, **given), bodyName=link, updateRate=rate)


_PLUGINS: dict[str, Callable[[Element, Names, Notes], Device]] = {
    "gazebo_ros_diff_drive": _drive,
    "gazebo_ros_skid_steer_drive": _skid_steer,
    "gazebo_ros_planar_move": partial(_plain, PlanarMove),
    "gazebo_ros_control": partial(_plain, RosControl, known={"controlPeriod", "robotSimType", "legacyModeNS"}),
    "gazebo_ros_imu": _imu,
    "hector_gazebo_ros_imu": _imu,
    "hector_gazebo_ros_gps": partial(_plain, Gps),
    "gazebo_ros_p3d": partial(_plain, GroundTruth),
    "gazebo_ros_joint_state_publisher": partial(_plain, JointStatePublisher),
    "pioneer_base_driver": _base_driver,
}
