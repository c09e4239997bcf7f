"""State of one computer of the fleet, and its stage of start-up."""

import dataclasses
import enum
from collections.abc import Iterable, Mapping
from typing import Any

from pioneer_fleet.monitor.monitor import RobotMonitor

QUIET = ("active", "rate-limited")
"""States of rules that need no attention (docs/gateway.md)."""

CARRYING = (*QUIET, "mtu")
"""States of a working rule."""


class Stage(enum.IntEnum):
    """Start-up stage of a computer; each stage includes the previous ones."""

    STARTING = 0
    CONNECTED = 1
    LINKED = 2
    SENSING = 3
    READY = 4
    MOVING = 5


@dataclasses.dataclass
class Report(RobotMonitor):
    """The newest data of a computer; None or empty if never received."""

    computer: str  #: host name
    robot: str = ""  #: the robot driven from here; empty on the base station
    gateway: str = ""  #: the gateway's name
    hub: str = ""  #: the hub that the gateway is connected to; empty for none
    rules: dict[str, str] = dataclasses.field(
        default_factory=dict
    )  #: state of each rule, by its description
    #: real_time_factor, models: the simulator's, on the base station
    real_time_factor: float | None = None
    models: tuple[str, ...] = ()

    @property
    def simulating(self) -> bool:
        """Whether the simulator runs and has robots."""
        return self.real_time_factor is not None and bool(self.models)

    @property
    def active(self) -> int:
        """Number of working rules."""
        return sum(state in CARRYING for state in self.rules.values())

    @property
    def stage(self) -> Stage:
        """The stage this computer has reached."""
        if not self.hub:
            return Stage.STARTING
        if not self.rules or self.active < len(self.rules):
            return Stage.CONNECTED
        if not self.robot:
            return Stage.MOVING if self.simulating else Stage.LINKED
        if self.odom_at is None or self.scan_at is None:
            return Stage.LINKED
        if self.pose is None or self.queue is None:
            return Stage.SENSING
        return Stage.MOVING if self.moving else Stage.READY

    @property
    def lacks(self) -> str:
        """Description of what is missing for the next stage; empty if nothing is."""
        if not self.gateway:
            return "no gateway on this computer yet"
        if not self.hub:
            return f"{self.gateway} has not found the hub"
        if not self.rules:
            return "no rules yet"
        idle = [
            f"{about}: {state}"
            for about, state in sorted(self.rules.items())
            if state not in CARRYING
        ]
        if idle:
            return idle[0] + (f" (and {len(idle) - 1} more)" if len(idle) > 1 else "")
        if not self.robot:
            return "" if self.simulating else "the simulator does not run yet"
        if self.odom_at is None or self.scan_at is None:
            return f"no {'odometry' if self.odom_at is None else 'scan'} received"
        if self.pose is None:
            return "amcl has not localised the robot"
        return "" if self.queue is not None else "no waypoint client yet"

    def has_come(self, until: Stage) -> bool:
        """Returns whether stage ``until`` is reached; a robot that stands at its last waypoint counts as moving."""
        queue = self.queue
        has_driven = (
            self.stage is Stage.READY
            and queue is not None
            and queue.reached > 0
            and not queue.waiting
        )
        return self.stage >= until or (until is Stage.MOVING and has_driven)

    def has_arrived(self, count: int) -> bool:
        """Returns whether at least ``count`` waypoints were received and none is waiting; always true for 0."""
        queue = self.queue
        return not count or (queue is not None and queue.received >= count and not queue.waiting)

    def as_json(self, now: float) -> dict[str, Any]:
        """Returns the report for ``json.dumps``, with ages [s] instead of times. ``now`` is monotonic [s]."""
        return {
            "computer": self.computer,
            "robot": self.robot,
            "stage": self.stage.name.lower(),
            "lacks": self.lacks,
            "gateway": self.gateway,
            "hub": self.hub,
            "rules": len(self.rules),
            "active": self.active,
            **self.robot_json(now),
            "real_time_factor": self.real_time_factor,
            "models": list(self.models),
        }


def states_of(rules: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Returns the state of each relevant rule, by its description.

    A rule for a specific node belongs to a tool such as RViz, which comes and goes: it counts only while it works.

    Args:
        rules: the values of each rule's status on ``/gateway/rules``.
    """
    states = {}
    for rule in rules:
        about = " ".join(
            rule[key] for key in ("action", "gateway", "type", "name", "node") if rule.get(key)
        )
        if rule["state"] in CARRYING or not rule.get("node"):
            states[about] = rule["state"]
    return states
