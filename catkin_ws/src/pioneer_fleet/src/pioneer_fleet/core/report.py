"""The state of one computer of the fleet, and the one word that sums it up."""

import dataclasses
import enum
from collections.abc import Iterable, Mapping
from typing import Any

from pioneer_fleet.core.monitor import RobotMonitor

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
class Report(RobotMonitor):
    """The newest of everything; what was never received is None or empty."""

    computer: str  #: name of the host
    robot: str = ""  #: the robot driven from here; empty on the base station
    gateway: str = ""  #: the gateway's name
    hub: str = ""  #: the hub it is connected to; empty for none
    rules: dict[str, str] = dataclasses.field(default_factory=dict)  #: state of each rule, by what it is about
    #: real_time_factor, models: the simulator's, on the base station
    real_time_factor: float | None = None
    models: tuple[str, ...] = ()

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
        if self.pose is None or self.queue is None:
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
        return "" if self.queue is not None else "no waypoint client yet"

    def has_come(self, until: Stage) -> bool:
        """Returns whether it has come so far; a robot that has reached its waypoints and stands there has moved."""
        queue = self.queue
        has_driven = self.stage is Stage.READY and queue is not None and queue.reached > 0 and not queue.waiting
        return self.stage >= until or (until is Stage.MOVING and has_driven)

    def has_arrived(self, count: int) -> bool:
        """Returns whether ``count`` waypoints came and none of them waits; with 0, always."""
        queue = self.queue
        return not count or (queue is not None and queue.received >= count and not queue.waiting)

    def as_json(self, now: float) -> dict[str, Any]:
        """Returns the report for ``json.dumps``; ages [s] in place of times. ``now`` is monotonic [s]."""
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
    """Returns the state of each rule that counts, by what the rule is about.

    A rule for one node belongs to a tool, such as RViz, which comes and goes: it counts while it carries only.

    Args:
        rules: the values of each rule's status on ``/gateway/rules``.
    """
    states = {}
    for rule in rules:
        about = " ".join(rule[key] for key in ("action", "gateway", "type", "name", "node") if rule.get(key))
        if rule["state"] in CARRYING or not rule.get("node"):
            states[about] = rule["state"]
    return states
