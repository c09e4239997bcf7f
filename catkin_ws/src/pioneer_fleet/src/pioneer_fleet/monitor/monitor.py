"""State of one robot, as seen on its own computer or, through the gateways, on the base station."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_fleet.monitor.state import State, state_of

MOVING_SPEED = 0.02
"""A robot stands still if it drives slower than this [m/s] and turns slower than five times this [rad/s]."""


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
    #: the newest states that the servers of its actions have reported, by action
    said: dict[str, State] = dataclasses.field(default_factory=dict)

    @property
    def state(self) -> State:
        """What the robot is doing, if it is localised and can be reached."""
        return state_of(self.queue, self.said)

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
            **self.state.as_json(),
            "moving": self.moving,
            "speed": round(self.linear, 2) + 0.0,  # no -0.0
            "pose": None if self.pose is None else [round(value, 3) for value in self.pose],
            "deviation": self.deviation if self.deviation is None else round(self.deviation, 3),
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
