"""Reads ros_control controllers from the parameters that their YAML files load into a robot's namespace."""

import difflib
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.model import Cylinder, Link, Model, Sphere
from pioneer_gazebo.world.robot import (
    ODOMETRY_COVARIANCE,
    Device,
    Diagonal,
    DiffDrive,
    JointStatePublisher,
    Limits,
    Robot,
    RosControl,
)

DIFF_DRIVE, JOINT_STATES = (
    "diff_drive_controller/DiffDriveController",
    "joint_state_controller/JointStateController",
)
WITHOUT_EFFECT = {
    "type", "velocity_rolling_window_size", "open_loop",
    "estimate_velocity_from_position", "allow_multiple_cmd_vel_publishers", "publish_cmd",
}  # fmt: skip
STRONGEST = 100.0
"""Wheel torque if the joint has no usable effort limit [N m]."""


def controlled(owner: Robot | Model, parameters: Any) -> tuple[tuple[Device, ...], list[str]]:
    """Returns a robot's devices, with controllers replacing ``libgazebo_ros_control.so``, and notes on what is ignored.

    Every controller in ``parameters`` runs, whereas ros_control runs only those that a spawner names.

    Args:
        owner: the robot.
        parameters: those in its namespace.

    Raises:
        DescriptionError: a value is invalid, or the robot has no such wheel joint.
    """
    devices: list[Any] = [device for device in owner.devices if not isinstance(device, RosControl)]
    notes: list[str] = []
    found = parameters.items() if isinstance(parameters, Mapping) else ()
    for name, value in found:
        kind = value.get("type") if isinstance(value, Mapping) else None
        if kind == DIFF_DRIVE:
            devices.append(_diff_drive(_Settings(name, value, notes), owner))
        elif kind == JOINT_STATES:
            rate = _Settings(name, value, notes).number("publish_rate", 50.0)
            devices.append(JointStatePublisher(name, updateRate=rate))
        elif isinstance(kind, str) and "controller" in kind:
            notes.append(f"controller {name} of type {kind} is not supported and ignored")
    if not any(isinstance(device, DiffDrive) for device in devices):
        notes.append(
            f"libgazebo_ros_control.so drives nothing: load the YAML of a {DIFF_DRIVE} before spawning"
        )
    return tuple(devices), notes


class _Settings:
    """Reads a controller's parameters with checks."""

    def __init__(self, name: str, values: Mapping[str, Any], notes: list[str]) -> None:
        self.name, self.values, self.notes = name, values, notes
        self._read = set(WITHOUT_EFFECT)

    def get(self, key: str, default: Any = None) -> Any:
        self._read.add(key)
        return self.values.get(key, default)

    def number(self, key: str, default: float, least: float = 1e-9) -> float:
        value = self.get(key, default)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not least <= value < math.inf
        ):
            bound = "" if least < 0 else " >= 0" if least == 0 else " > 0"
            got = "is missing and" if value is default else f"is {value!r} and"
            raise DescriptionError(f"{self.name}/{key} {got} must be a number{bound}")
        return float(value)

    def joints(self, key: str, known: Sequence[str]) -> tuple[str, ...]:
        value = self.get(key)
        names = (
            tuple(map(str, value))
            if isinstance(value, list | tuple)
            else (str(value),) * (value is not None)
        )
        if not names:
            raise DescriptionError(f"{self.name}/{key} is missing")
        for name in names:
            if name not in known:
                near = "".join(
                    f"; did you mean {one!r}?"
                    for one in difflib.get_close_matches(name, known, n=1)
                )
                raise DescriptionError(f"{self.name}/{key}: unknown joint {name!r}{near}")
        return names

    def limits(self, group: str, axis: str) -> Limits:
        """Returns the limits of one axis; as in ros_control, a lower bound defaults to the negated upper bound."""
        outer = self.get(group, {})
        inner = _Settings(f"{self.name}/{group}/{axis}", outer.get(axis, {}), self.notes)
        bounds = []
        for kind in ("velocity", "acceleration"):
            if inner.get(f"has_{kind}_limits", False):
                most = inner.number(f"max_{kind}", math.nan)
                bounds += [inner.number(f"min_{kind}", -most, -math.inf), most]
            else:
                bounds += [-math.inf, math.inf]
        if inner.get("has_jerk_limits", False):
            self.notes.append(f"{inner.name}/has_jerk_limits is not supported and ignored")
        return Limits(*bounds)

    def diagonal(self, key: str) -> Diagonal:
        """Returns the diagonal of a covariance matrix; one that is invalid is noted and left out."""
        values = self.get(key, ODOMETRY_COVARIANCE)
        try:
            x, y, z, roll, pitch, yaw = map(float, values)
        except (TypeError, ValueError):
            self.notes.append(f"{self.name}/{key} is ignored: it must be 6 numbers, not {values!r}")
            return ODOMETRY_COVARIANCE
        return x, y, z, roll, pitch, yaw

    def note_unread(self) -> None:
        for key in sorted(set(self.values) - self._read):
            self.notes.append(f"{self.name}/{key} is not supported and ignored")


def _diff_drive(settings: _Settings, owner: Robot | Model) -> DiffDrive:
    joints = {joint.name: joint for joint in owner.joints}
    left, right = (settings.joints(f"{side}_wheel", tuple(joints)) for side in ("left", "right"))
    if len(left) != len(right):
        raise DescriptionError(
            f"{settings.name}: as many left as right wheels are needed, not {left} and {right}"
        )
    links = {link.name: link for link in owner.links}
    wheels = [links[joints[side[0]].child] for side in (left, right)]
    separation = settings.number(
        "wheel_separation", math.dist(*(wheel.pose.position for wheel in wheels))
    )
    radius = settings.number("wheel_radius", _radius(wheels[0]))
    both = settings.number("wheel_radius_multiplier", 1.0)
    each = [settings.number(f"{side}_wheel_radius_multiplier", both) for side in ("left", "right")]
    effort = min(joints[name].effort for name in left + right)
    name = settings.name
    drive = DiffDrive(
        name,
        leftJoint=left[0],
        rightJoint=right[0],
        leftRearJoint=left[1:],
        rightRearJoint=right[1:],
        wheelSeparation=separation * settings.number("wheel_separation_multiplier", 1.0),
        wheelDiameter=radius * sum(each),
        wheelTorque=effort if 0 < effort <= STRONGEST else STRONGEST,
        commandTimeout=settings.number("cmd_vel_timeout", 0.5, 0.0),
        updateRate=settings.number("publish_rate", 50.0),
        commandTopic=f"{name}/cmd_vel",
        odometryTopic=f"{name}/odom",
        odometryFrame=str(settings.get("odom_frame_id", "odom")),
        robotBaseFrame=str(settings.get("base_frame_id", "base_link")),
        odometrySource="encoder",
        publishOdomTF=bool(settings.get("enable_odom_tf", True)),
        legacyMode="false",
        speedLimits=settings.limits("linear", "x"),
        turnLimits=settings.limits("angular", "z"),
        poseCovariance=settings.diagonal("pose_covariance_diagonal"),
        twistCovariance=settings.diagonal("twist_covariance_diagonal"),
    )
    if each[0] != each[1]:
        settings.notes.append(
            f"{name}: wheels of different radius are not supported; their mean is taken"
        )
    settings.note_unread()
    return drive


def _radius(wheel: Link) -> float:
    """Returns the radius of a wheel's cylinder or sphere, the default of ``wheel_radius``; NaN if it has neither."""
    shapes = (collision.shape for collision in wheel.collisions)
    return next(
        (shape.radius for shape in shapes if isinstance(shape, Cylinder | Sphere)), math.nan
    )
