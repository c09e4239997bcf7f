"""State of one robot, as seen on its own computer or, through the gateways, on the base station."""

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import Any

MOVE_BASE, RIGHT_OF_WAY = "move_base", "traffic"
"""Actions whose servers report what a robot does."""
MOVING_SPEED = 0.02
"""A robot stands still if it drives slower than this [m/s] and turns slower than five times this [rad/s]."""


class ClientState(enum.IntEnum):
    """States of the waypoint client, numbered as in ``simple_navigation_goals/WaypointQueue``."""

    IDLE = 0
    WAITING_FOR_MOVE_BASE = 1
    DRIVING = 2
    RESTING = 3
    UNKNOWN = 255  #: a number that this version does not know


@dataclasses.dataclass(frozen=True)
class Queue:
    """A report of the waypoint client."""

    state: ClientState  #: its current state
    #: received, reached, aborted: waypoints so far
    received: int
    reached: int
    aborted: int
    text: str  #: its last status text
    waiting: int = 0  #: waypoints not reached yet, including the current one


@dataclasses.dataclass(kw_only=True)
class RobotMonitor:
    """The newest data of a robot; None if never received."""

    #: odom_at, scan_at: arrival time of the last message, monotonic [s]
    odom_at: float | None = None
    scan_at: float | None = None
    #: odom_stamp, scan_stamp: their stamps [s of simulated time]
    odom_stamp: float | None = None
    scan_stamp: float | None = None
    #: odom_gap, scan_gap: longest interval between two stamps so far [s of simulated time]; a paused simulator causes
    #: no gap, a link that loses messages does
    odom_gap: float = 0.0
    scan_gap: float = 0.0
    #: linear, angular: the robot's speed [m/s, rad/s]
    linear: float = 0.0
    angular: float = 0.0
    pose: tuple[float, float, float] | None = None  #: x, y [m] and heading [rad] in ``map``
    deviation: float | None = None  #: standard deviation of the position that amcl estimates [m]
    queue: Queue | None = None  #: the waypoint client's newest report
    #: by action, why the robot does not get on, in its server's words; empty if it does, or has no goal
    troubles: dict[str, str] = dataclasses.field(default_factory=dict)
    #: by action, what its server waits for at the start; empty for nothing
    lacks_at_start: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def action(self) -> str:
        """Name of the action that takes the robot's waypoints."""
        return RIGHT_OF_WAY if RIGHT_OF_WAY in self.troubles else MOVE_BASE

    @property
    def hindrance(self) -> str:
        """Why the robot does not get on; empty if it does, or has no goal.

        What the right of way says comes before what move_base says.
        """
        for action in (RIGHT_OF_WAY, MOVE_BASE):
            if self.lacks_at_start.get(action):
                return self.lacks_at_start[action]
        if self.queue is not None and self.queue.state is ClientState.WAITING_FOR_MOVE_BASE:
            return f"waiting for {self.action}"  # what that said last is out of date
        return self.troubles.get(RIGHT_OF_WAY, "") or self.troubles.get(MOVE_BASE, "")

    @property
    def moving(self) -> bool:
        """Whether the robot drives or turns."""
        return abs(self.linear) > MOVING_SPEED or abs(self.angular) > 5 * MOVING_SPEED

    def add_odom(self, now: float, stamp: float) -> None:
        """Records odometry that arrived ``now`` (monotonic [s]) with ``stamp`` [s]."""
        self.odom_gap = _longer_gap(self.odom_gap, self.odom_stamp, stamp)
        self.odom_at, self.odom_stamp = now, stamp

    def add_scan(self, now: float, stamp: float) -> None:
        """Records a scan that arrived ``now`` (monotonic [s]) with ``stamp`` [s]."""
        self.scan_gap = _longer_gap(self.scan_gap, self.scan_stamp, stamp)
        self.scan_at, self.scan_stamp = now, stamp

    def robot_json(self, now: float) -> dict[str, Any]:
        """Returns the robot's part of a report for ``json.dumps``, with ages [s] for times; ``now`` is monotonic."""
        queue = self.queue or Queue(ClientState.IDLE, 0, 0, 0, "")
        return {
            "odom_age": _age(self.odom_at, now),
            "odom_gap": round(self.odom_gap, 2),
            "scan_age": _age(self.scan_at, now),
            "scan_gap": round(self.scan_gap, 2),
            "moving": self.moving,
            "speed": round(self.linear, 2) + 0.0,  # no -0.0
            "pose": None if self.pose is None else [round(value, 3) for value in self.pose],
            "deviation": self.deviation if self.deviation is None else round(self.deviation, 3),
            "hindrance": self.hindrance,
            "waypoint": None if self.queue is None else queue.text,
            "waiting": queue.waiting,
            "received": queue.received,
            "reached": queue.reached,
            "aborted": queue.aborted,
        }


def deviation_from_covariance(covariance: Sequence[float]) -> float:
    """Returns the larger standard deviation of x and y [m] from a row-major 6 × 6 covariance."""
    return math.sqrt(max(covariance[0], covariance[7], 0.0))


def _longer_gap(gap: float, last: float | None, stamp: float) -> float:
    return gap if last is None else max(gap, stamp - last)


def _age(moment: float | None, now: float) -> float | None:
    return None if moment is None else round(now - moment, 2)
