"""Reads ros_control controllers from the parameters that their YAML files load into a robot's namespace."""

import difflib
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.model import Cylinder, Link, Model, Sphere
from pioneer_gazebo.world.robot import (
    EFFORT,
    ODOMETRY_COVARIANCE,
    POSITION,
    VELOCITY,
    Device,
    Diagonal,
    DiffDrive,
    JointControl,
    JointStatePublisher,
    Limits,
    PlanarMove,
    Robot,
    RosControl,
)

DIFF_DRIVE = "diff_drive_controller/DiffDriveController"
WITHOUT_EFFECT = {
    "type", "velocity_rolling_window_size", "open_loop",
    "estimate_velocity_from_position", "allow_multiple_cmd_vel_publishers", "publish_cmd",
}  # fmt: skip
MOVING = (DiffDrive, PlanarMove, JointControl)
"""Devices that move something."""
COB_ODOMETRY = "cob_omni_drive_controller/OdometryController"
STRONGEST = 100.0
"""Wheel torque if the joint has no usable effort limit [N m]."""


def controlled(owner: Robot | Model, parameters: Any) -> tuple[tuple[Device, ...], list[str]]:
    """Returns a robot's devices, with controllers replacing ``libgazebo_ros_control.so``, and notes on what is ignored.

    Every controller in ``parameters`` runs, whereas ros_control runs only those that a spawner names.

    Args:
        owner: the robot.
        parameters: those in its namespace.

    Raises:
        DescriptionError: a value of a drive is invalid, or the robot has no such wheel joint. Other controllers that
            are invalid are left out, with a note.
    """
    plugin = next(device for device in owner.devices if isinstance(device, RosControl))
    devices: list[Any] = []
    notes: list[str] = []
    found = parameters.items() if isinstance(parameters, Mapping) else ()
    for name, value in found:
        kind = value.get("type") if isinstance(value, Mapping) else None
        reader = _CONTROLLERS.get(kind) if isinstance(kind, str) else None
        if reader is not None:
            settings = _Settings(name, value, notes, parameters)
            try:
                devices.append(replace(reader(settings, owner), namespace=plugin.namespace))
                settings.note_unread()
            except DescriptionError as error:
                if kind == DIFF_DRIVE:
                    raise
                notes.append(f"{error}; the controller is left out")
        elif isinstance(kind, str) and "controller" in kind.lower() and kind != COB_ODOMETRY:
            notes.append(f"controller {name} of type {kind} is not supported and ignored")
    kept = [device for device in owner.devices if not isinstance(device, RosControl)]
    if len(kept) < len(owner.devices) - 1:
        notes.append("libgazebo_ros_control.so is there more than once: the first one is used")
    notes += _shared_joints(devices)
    if not any(isinstance(device, MOVING) for device in (*kept, *devices)):
        notes.append(
            f"libgazebo_ros_control.so drives nothing: load the YAML of a {DIFF_DRIVE} before spawning"
        )
    return (*kept, *devices), notes


def _shared_joints(devices: Sequence[Any]) -> list[str]:
    """Returns a note for each joint that several controllers move, or one controller twice."""
    names = [
        name for device in devices if isinstance(device, JointControl) for name in device.jointName
    ]
    return [
        f"joint {name} has several controllers: the last one moves it"
        for name, count in Counter(names).items()
        if count > 1
    ]


class _Settings:
    """Reads a controller's parameters with checks."""

    def __init__(
        self, name: str, values: Mapping[str, Any], notes: list[str], siblings: Any = None
    ) -> None:
        self.name, self.values, self.notes = name, values, notes
        self.siblings = siblings  # parameters of all controllers by name
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
        outer = self._mapping(self.name, group, self.get(group, {}))
        own = self._mapping(f"{self.name}/{group}", axis, outer.get(axis, {}))
        inner = _Settings(f"{self.name}/{group}/{axis}", own, self.notes)
        bounds = []
        for kind in ("velocity", "acceleration"):
            if inner.get(f"has_{kind}_limits", False):
                most = inner.number(f"max_{kind}", math.nan)
                least = inner.number(f"min_{kind}", -most, -math.inf)
                if least > most or (kind == "acceleration" and least >= 0):
                    self.notes.append(
                        f"{inner.name}/min_{kind} is ignored: {least:g} is no lower bound beside {most:g}"
                    )
                    least = -most
                bounds += [least, most]
            else:
                bounds += [-math.inf, math.inf]
        if inner.get("has_jerk_limits", False):
            self.notes.append(f"{inner.name}/has_jerk_limits is not supported and ignored")
        return Limits(*bounds)

    def _mapping(self, name: str, key: str, value: Any) -> Mapping[str, Any]:
        """Returns a value that must hold parameters; any other is noted and left out."""
        if isinstance(value, Mapping):
            return value
        note = f"{name}/{key} is ignored: it must hold parameters, not {value!r}"
        if note not in self.notes:  # a group is read for each of its axes
            self.notes.append(note)
        return {}

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
    return drive


def _joint_states(settings: _Settings, owner: Robot | Model) -> JointStatePublisher:
    del owner
    settings.get("extra_joints")
    return JointStatePublisher(settings.name, updateRate=settings.number("publish_rate", 50.0))


def _joint_control(
    kind: str, is_group: bool, settings: _Settings, owner: Robot | Model
) -> JointControl:
    movable = [joint.name for joint in owner.joints if joint.kind != kinds.FIXED]
    joints = settings.joints("joints" if is_group else "joint", movable)
    if not is_group and len(joints) != 1:
        raise DescriptionError(f"{settings.name}/joint must be one joint, not {len(joints)}")
    if settings.get("pid") is not None or any(settings.get(name) is not None for name in joints):
        settings.notes.append(
            f"{settings.name}: gains have no effect: joints follow their commands at once"
        )
    return JointControl(settings.name, joints, kind, is_group)


def _mecanum(settings: _Settings, owner: Robot | Model) -> PlanarMove:
    """Reads the controller of a base with mecanum wheels, which moves here as commanded, wheels standing still."""
    del owner
    name = settings.name
    for key in _MECANUM_WHEELS:
        settings.get(key)
    for key in ("pose_covariance_diagonal", "twist_covariance_diagonal"):
        settings.get(key)
    return PlanarMove(
        name,
        commandTopic=f"{name}/cmd_vel",
        odometryTopic=f"{name}/odom",
        odometryFrame=str(settings.get("odom_frame_id", "odom")),
        robotBaseFrame=str(settings.get("base_frame_id", "base_link")),
        odometryRate=settings.number("publish_rate", 50.0),
        publishTf=bool(settings.get("enable_odom_tf", True)),
        commandTimeout=settings.number("cmd_vel_timeout", 0.5, 0.0),
        aheadLimits=settings.limits("linear", "x"),
        leftLimits=settings.limits("linear", "y"),
        turnLimits=settings.limits("angular", "z"),
    )


_MECANUM_WHEELS = (
    *(f"{side}_wheel{end}" for side in ("front_left", "front_right", "back_left", "back_right")
      for end in ("", "_joint")),
    "front_wheel_joint", "wheel_separation_x", "wheel_separation_y", "wheel_radius",
    "wheel_separation_multiplier", "wheel_radius_multiplier",
)  # fmt: skip
"""Parameters of a mecanum controller that say how its wheels turn."""


def _cob(settings: _Settings, owner: Robot | Model) -> PlanarMove:
    """Reads the controller of a Care-O-bot's steered wheels; its odometry is a controller of its own."""
    del owner
    for key in (
        "wheels",
        "defaults",
        "max_rot_velocity",
        "max_trans_velocity",
        "required_drive_chain",
    ):
        settings.get(key)
    name = "odometry_controller"
    values: Mapping[str, Any] = {}
    others = settings.siblings if isinstance(settings.siblings, Mapping) else {}
    for other, given in others.items():
        if isinstance(given, Mapping) and given.get("type") == COB_ODOMETRY:
            name, values = other, given
    odometry = _Settings(name, values, settings.notes)
    return PlanarMove(
        settings.name,
        commandTopic=f"{settings.name}/command",
        odometryTopic=f"{name}/odometry",
        odometryFrame=str(odometry.get("frame_id", "odom")),
        robotBaseFrame=str(odometry.get("child_frame_id", "base_footprint")),
        odometryRate=odometry.number("publish_rate", 50.0),
        publishTf=bool(odometry.get("broadcast_tf", True)),
        commandTimeout=settings.number("timeout", 0.1, 0.0),
    )


def _radius(wheel: Link) -> float:
    """Returns the radius of a wheel's cylinder or sphere, the default of ``wheel_radius``; NaN if it has neither."""
    shapes = (collision.shape for collision in wheel.collisions)
    return next(
        (shape.radius for shape in shapes if isinstance(shape, Cylinder | Sphere)), math.nan
    )


def _joint_controllers() -> dict[str, Callable[[_Settings, Robot | Model], Any]]:
    """Returns the reader of each type of joint controller: interface, what its commands mean, whether it is a group."""
    readers: dict[str, Callable[[_Settings, Robot | Model], Any]] = {}
    for interface, names in {
        "position_controllers": {"Position": POSITION},
        "velocity_controllers": {"Position": POSITION, "Velocity": VELOCITY},
        "effort_controllers": {"Position": POSITION, "Velocity": VELOCITY, "Effort": EFFORT},
    }.items():
        for name, kind in names.items():
            for group in ("", "Group"):
                readers[f"{interface}/Joint{group}{name}Controller"] = partial(
                    _joint_control, kind, bool(group)
                )
    return readers


_CONTROLLERS: dict[str, Callable[[_Settings, Robot | Model], Any]] = {
    DIFF_DRIVE: _diff_drive,
    "joint_state_controller/JointStateController": _joint_states,
    "mecanum_drive_controller/MecanumDriveController": _mecanum,
    "ridgeback_control/MecanumDriveController": _mecanum,
    "cob_omni_drive_controller/WheelController": _cob,
    **_joint_controllers(),
}
"""Reads a controller of each type."""
