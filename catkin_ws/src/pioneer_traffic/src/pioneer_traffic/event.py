"""What happens to a robot's pilot, what it sees, and what it asks for."""

from dataclasses import dataclass
from enum import Enum

from pioneer_traffic.geometry import Point
from pioneer_traffic.report import Report
from pioneer_traffic.roadmap import Roadmap
from simple_navigation_goals.queue import Outcome


@dataclass(frozen=True)
class NewGoal:
    """A goal replaces the active one; ``fault`` is why it cannot be accepted, empty if it can."""

    point: Point
    fault: str = ""


@dataclass(frozen=True)
class GoalCancelled:
    """The active goal was cancelled by its client, or the client has ended."""

    reason: str


@dataclass(frozen=True)
class CancelRequested:
    """Another node asked for the cancellation of goals of move_base, or of all goals."""

    everything: bool = False
    number: int = 0  #: of the stretch that is to be cancelled; 0 for none
    stamp: float = 0.0  #: goals sent until then are to be cancelled [s of ROS time]; 0 for none
    reason: str = "cancelled by another node"


@dataclass(frozen=True)
class MoveBaseTaken:
    """Another node sent a goal to move_base."""

    node: str


@dataclass(frozen=True)
class StretchEnded:
    """move_base ended a goal."""

    number: int
    outcome: Outcome
    text: str


@dataclass(frozen=True)
class NewRoadmap:
    """A map has arrived, and this is its roadmap."""

    roadmap: Roadmap


@dataclass(frozen=True)
class Heard:
    """A report of another robot has arrived."""

    report: Report


Event = (
    NewGoal | GoalCancelled | CancelRequested | MoveBaseTaken | StretchEnded | NewRoadmap | Heard
)


@dataclass(frozen=True)
class Inputs:
    """What the pilot sees in a step."""

    position: Point | None  #: of the robot in map; None if unknown
    stamp: float  #: ROS time [s]
    present: bool = True  #: whether move_base is connected
    obstacles: tuple[Point, ...] = ()  #: positions of robots that send no reports


@dataclass(frozen=True)
class Drive:
    """Send move_base a goal; ``number`` counts these actions from 1. ``final``: with the goal's own heading."""

    number: int
    stop: Point
    before: Point  #: the point from which the robot comes to the stop
    final: bool


@dataclass(frozen=True)
class CancelDrive:
    """Cancel the last goal sent to move_base."""


@dataclass(frozen=True)
class Finish:
    """End the active goal."""

    outcome: Outcome
    text: str


@dataclass(frozen=True)
class Send:
    """Send this robot's report to the others."""

    report: Report


@dataclass(frozen=True)
class Note:
    """Log a warning."""

    text: str


Action = Drive | CancelDrive | Finish | Send | Note


class Condition(Enum):
    """What a robot does by the right of way; the values are the words of ``nav_bundle/NavigationState``."""

    STARTING = "starting"
    IDLE = "idle"
    DRIVING = "driving"
    BLOCKED = "blocked"
    WAITING = "waiting"
    HELD = "held"
    FAILED = "failed"


@dataclass(frozen=True)
class Status:
    """What a robot does by the right of way, and why it does not get on."""

    condition: Condition = Condition.IDLE
    reason: str = ""  #: without a full stop; empty for none
    robots: tuple[str, ...] = ()  #: the robots that it waits for, or that stand in the way

    def text(self) -> str:
        """Returns the status for people."""
        return f"{self.condition.value}: {self.reason}" if self.reason else self.condition.value
