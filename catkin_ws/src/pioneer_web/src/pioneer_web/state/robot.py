"""The state of one robot as known at the base station, and the part of it sent to pages."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pioneer_fleet.geometry import Points, Pose
from pioneer_fleet.monitor.monitor import RobotMonitor
from pioneer_fleet.monitor.state import Activity

STALE = 2.0
"""Age at which odometry or scans count as a fault [s]."""
BEAMS = 180
"""Approximate number of beams shown per scan."""


@dataclasses.dataclass(frozen=True)
class Image:
    """A costmap as an image."""

    corner: Pose  #: pose of the lower left corner, in the costmap's frame
    #: width, height: size [m]
    width: float
    height: float
    png: str  #: base64-encoded PNG


@dataclasses.dataclass(kw_only=True)
class Robot(RobotMonitor):
    """The newest data of a robot; None or empty if never received."""

    name: str  #: its namespace
    gateway: str  #: the gateway of its computer
    correction: Pose | None = None  #: pose of its odometry frame in ``map``
    odometry: Pose | None = None  #: its pose in its odometry frame
    mount: Pose = dataclasses.field(
        default_factory=lambda: Pose(0.0, 0.0)
    )  #: pose of its laser on its base
    #: first angle and angle step [rad], ranges [cm] with 0 for no return
    scan: tuple[float, float, list[int]] | None = None
    #: plan, local_plan: frame and points [m]
    plan: tuple[str, Points] = ("", [])
    local_plan: tuple[str, Points] = ("", [])
    costs: tuple[str, Image] | None = None  #: frame and image of the local costmap
    goals: Sequence[Pose] = ()  #: the current waypoint and those waiting, in ``map``
    battery: float | None = None  #: charge, 0 … 1
    load: Sequence[float] | None = (
        None  #: processors and memory [MiB] used by the programs on its computer
    )
    held: bool = False  #: whether the dashboard holds it stopped
    patrols: bool = False  #: whether it repeats its waypoints

    @property
    def place(self) -> Pose | None:
        """Its pose in ``map``; None until it is localised."""
        if self.correction is None or self.odometry is None:
            return None
        return self.correction.compose(self.odometry)

    @property
    def complaint(self) -> str:
        """Why the robot cannot carry out its task, in its own words; empty while it may come right by itself."""
        return self.state.text if self.state.activity in _COMPLAINTS else ""

    def fault(self, rules: Mapping[str, Sequence[tuple[str, str]]], now: float) -> str:
        """Returns a description of the robot's fault; empty if there is none.

        Args:
            rules: state and reason of each rule, by remote gateway.
            now: monotonic [s].
        """
        for state, reason in rules.get(self.gateway, ()):
            if state.startswith(_FAULTS):
                return f"{self.gateway}: {state}" + (f", {reason}" if reason else "")
        for what, at in (("odometry", self.odom_at), ("scan", self.scan_at)):
            if at is None:
                return f"no {what} received"
            if now - at > STALE:
                return f"no {what} for {now - at:.0f} s"
        return "" if self.correction else "amcl has not localised it"

    def values(self, fault: str, now: float) -> dict[str, Any]:
        """Returns the values that a page draws: poses as [x, y, yaw], lines as [x, y, …] in cm."""
        return {
            "pose": _numbers(self.place),
            "scan": self.scan and [*self.scan, _numbers(self._seen_from())],
            "mount": _numbers(self.mount),
            "plan": self._line(self.plan),
            "local": self._line(self.local_plan),
            "costs": self._costs(),
            "goals": [_numbers(goal) for goal in self.goals],
            "row": self._row(fault, now),
        }

    def _seen_from(self) -> Pose | None:
        """Returns its pose when the newest scan was taken, extrapolated from its current pose and velocity."""
        if self.place is None or self.odom_stamp is None or self.scan_stamp is None:
            return self.place
        since = max(0.0, min(1.0, self.odom_stamp - self.scan_stamp))
        return self.place.compose(Pose(-self.linear * since, 0.0, -self.angular * since))

    def _row(self, fault: str, now: float) -> dict[str, Any]:
        shown = self.robot_json(now)
        names = (
            "activity",
            "state",
            "trouble",
            "moving",
            "speed",
            "deviation",
            "waypoint",
            "waiting",
            "received",
            "reached",
            "aborted",
        )
        return {
            **{name: shown[name] for name in names},
            "odom": _tenths(shown["odom_age"]),
            "scan": _tenths(shown["scan_age"]),
            "battery": self.battery,
            "load": self.load,
            "held": self.held,
            "patrols": self.patrols,
            "fault": fault,
        }

    def _line(self, line: tuple[str, Points]) -> list[int]:
        frame, points = line
        pose = self._frame(frame)
        if pose is None:
            return []
        cos, sin = 100 * math.cos(pose.yaw), 100 * math.sin(pose.yaw)
        return [
            round(part)
            for x, y in points
            for part in (100 * pose.x + cos * x - sin * y, 100 * pose.y + sin * x + cos * y)
        ]

    def _costs(self) -> dict[str, Any] | None:
        if self.costs is None or (pose := self._frame(self.costs[0])) is None:
            return None
        image = self.costs[1]
        return {
            "at": _numbers(pose.compose(image.corner)),
            "size": [image.width, image.height],
            "png": image.png,
        }

    def _frame(self, frame: str) -> Pose | None:
        """Returns the pose of a frame in ``map``; None if unknown."""
        return (
            Pose(0.0, 0.0)
            if frame == "map"
            else self.correction
            if frame == f"{self.name}/odom"
            else None
        )


_COMPLAINTS = (Activity.BLOCKED, Activity.LOST, Activity.FAILED)
_FAULTS = (
    "no such gateway",
    "unreachable",
    "refused",
    "firewalled",
    "type mismatch",
    "blacklisted",
)
"""Rule states that will not clear by themselves when the robot's nodes start."""


def _numbers(pose: Pose | None) -> list[float] | None:
    return None if pose is None else [round(pose.x, 3), round(pose.y, 3), round(pose.yaw, 3)]


def _tenths(age: float | None) -> float | None:
    return None if age is None else round(age, 1)
