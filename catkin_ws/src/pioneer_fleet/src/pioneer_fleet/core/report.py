"""What one computer of the fleet knows of itself, and the one word that sums it up."""

import dataclasses
import enum
import math
from typing import Any

MOVING_SPEED = 0.02
"""Slower than this [m/s], and turning slower than this [rad/s] times five, is standing."""

CARRYING = ("active", "rate-limited")
"""States of a rule in force (docs/gateway.md): an option that thins messages out is no fault."""


class Stage(enum.IntEnum):
    """How far a computer has come; each stage includes the ones before."""

    STARTING = 0
    CONNECTED = 1
    LINKED = 2
    SENSING = 3
    READY = 4
    MOVING = 5


@dataclasses.dataclass
class Report:
    """The newest of everything; what has never been heard is None or empty.

    Attributes:
        computer: name of the host.
        robot: the robot driven from here; empty on the base station.
        gateway: the gateway's name.
        hub: the hub it is connected to; empty for none.
        rules: state of each rule, by what it is about.
        odom_at, scan_at: when the last one came, monotonic [s].
        odom_stamp, scan_stamp: their stamps [s of simulated time].
        odom_gap, scan_gap: the longest time between two stamps so far [s of simulated time]: a simulator that stands
            still leaves no gap, a link that does not carry does.
        linear, angular: the robot's speed [m/s, rad/s].
        pose: x, y [m] and heading [rad] in ``map``, by amcl.
        deviation: standard deviation of that position [m].
        waypoint: the waypoint client's words.
        waiting: waypoints not reached yet, the one under way included.
        received, reached, aborted: waypoints so far.
        real_time_factor, models: the simulator's, on the base station.
    """

    computer: str
    robot: str = ""
    gateway: str = ""
    hub: str = ""
    rules: dict[str, str] = dataclasses.field(default_factory=dict)
    odom_at: float | None = None
    scan_at: float | None = None
    odom_stamp: float | None = None
    scan_stamp: float | None = None
    odom_gap: float = 0.0
    scan_gap: float = 0.0
    linear: float = 0.0
    angular: float = 0.0
    pose: tuple[float, float, float] | None = None
    deviation: float | None = None
    waypoint: str | None = None
    waiting: int = 0
    received: int = 0
    reached: int = 0
    aborted: int = 0
    real_time_factor: float | None = None
    models: tuple[str, ...] = ()

    @property
    def moving(self) -> bool:
        """Whether the robot drives or turns."""
        return abs(self.linear) > MOVING_SPEED or abs(self.angular) > 5 * MOVING_SPEED

    @property
    def simulating(self) -> bool:
        """Whether the simulator runs, with robots in it."""
        return self.real_time_factor is not None and bool(self.models)

    @property
    def active(self) -> int:
        """How many rules carry, or could."""
        return sum(state in CARRYING for state in self.rules.values())

    @property
    def stage(self) -> Stage:
        """How far this computer has come."""
        if not self.hub:
            return Stage.STARTING
        if not self.rules or self.active < len(self.rules):
            return Stage.CONNECTED
        if not self.robot:
            return Stage.MOVING if self.simulating else Stage.LINKED
        if self.odom_at is None or self.scan_at is None:
            return Stage.LINKED
        if self.pose is None or self.waypoint is None:
            return Stage.SENSING
        return Stage.MOVING if self.moving else Stage.READY

    @property
    def lacks(self) -> str:
        """What is missing for the next stage, in words; empty when nothing is."""
        if not self.gateway:
            return "no gateway on this computer yet"
        if not self.hub:
            return f"{self.gateway} has not found the hub"
        if not self.rules:
            return "no rules yet"
        idle = [f"{about}: {state}" for about, state in sorted(self.rules.items()) if state not in CARRYING]
        if idle:
            return idle[0] + (f" (and {len(idle) - 1} more)" if len(idle) > 1 else "")
        if not self.robot:
            return "" if self.simulating else "the simulator does not run yet"
        if self.odom_at is None or self.scan_at is None:
            return f"no {'odometry' if self.odom_at is None else 'scan'} has come"
        if self.pose is None:
            return "amcl has not localised the robot"
        return "" if self.waypoint is not None else "no waypoint client yet"

    def has_come(self, until: Stage) -> bool:
        """Returns whether it has come so far; a robot that has reached its waypoints and stands there has moved."""
        has_driven = self.stage is Stage.READY and self.reached > 0 and not self.waiting
        return self.stage >= until or (until is Stage.MOVING and has_driven)

    def hear_odom(self, now: float, stamp: float) -> None:
        """Takes note of odometry that came ``now`` (monotonic [s]) and is of ``stamp`` [s]."""
        self.odom_gap = _longer_gap(self.odom_gap, self.odom_stamp, stamp)
        self.odom_at, self.odom_stamp = now, stamp

    def hear_scan(self, now: float, stamp: float) -> None:
        """The same for a scan."""
        self.scan_gap = _longer_gap(self.scan_gap, self.scan_stamp, stamp)
        self.scan_at, self.scan_stamp = now, stamp

    def has_arrived(self, count: int) -> bool:
        """Returns whether ``count`` waypoints came and none of them waits; with 0, always."""
        return not count or (self.received >= count and not self.waiting)

    def as_json(self, now: float) -> dict[str, Any]:
        """Returns the report for ``json.dumps``; ages [s] in place of times. ``now`` is monotonic [s]."""

        def age(moment: float | None) -> float | None:
            return None if moment is None else round(now - moment, 2)

        return {
            "computer": self.computer,
            "robot": self.robot,
            "stage": self.stage.name.lower(),
            "lacks": self.lacks,
            "gateway": self.gateway,
            "hub": self.hub,
            "rules": len(self.rules),
            "active": self.active,
            "odom_age": age(self.odom_at),
            "odom_gap": round(self.odom_gap, 2),
            "scan_age": age(self.scan_at),
            "scan_gap": round(self.scan_gap, 2),
            "moving": self.moving,
            "speed": round(self.linear, 2),
            "pose": None if self.pose is None else [round(value, 3) for value in self.pose],
            "deviation": self.deviation if self.deviation is None else round(self.deviation, 3),
            "waypoint": self.waypoint,
            "waiting": self.waiting,
            "received": self.received,
            "reached": self.reached,
            "aborted": self.aborted,
            "real_time_factor": self.real_time_factor,
            "models": list(self.models),
        }


def _longer_gap(gap: float, last: float | None, stamp: float) -> float:
    return gap if last is None else max(gap, stamp - last)


def deviation_from_covariance(covariance: "list[float] | tuple[float, ...]") -> float:
    """Returns the larger standard deviation of x and y [m] from a 6 × 6 covariance, row by row."""
    return math.sqrt(max(covariance[0], covariance[7], 0.0))
