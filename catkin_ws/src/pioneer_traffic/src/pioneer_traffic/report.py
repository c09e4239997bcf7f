"""Data that the robots' coordinators exchange."""

from dataclasses import dataclass, field
from typing import NamedTuple

from pioneer_traffic.geometry import Point


class PlanId(NamedTuple):
    """Id of a plan; ordered by number, then by the name of the robot that made the plan."""

    number: int = 0
    author: str = ""


NO_PLAN = PlanId()


class Wait(NamedTuple):
    """``robot`` may enter place ``step`` of its path once ``other`` has reached place ``other_step`` of its own."""

    robot: str
    step: int
    other: str
    other_step: int


@dataclass(frozen=True)
class Plan:
    """Paths of the robots and the order in which they pass shared places."""

    id: PlanId = field(default_factory=PlanId)
    #: by robot, the places it held when the plan was made
    held: dict[str, tuple[int, ...]] = field(default_factory=dict)
    paths: dict[str, tuple[int, ...]] = field(
        default_factory=dict
    )  #: by robot, places from the last one held
    #: by robot, the places around its own that it alone may use, to leave the roadmap
    regions: dict[str, tuple[int, ...]] = field(default_factory=dict)
    waits: tuple[Wait, ...] = ()  #: order of passing, binding for all robots


@dataclass(frozen=True)
class Report:
    """State of one robot, sent to all others a few times a second."""

    robot: str  #: the robot's name
    roadmap: int  #: signature of its roadmap; robots with a different one do not take part
    position: Point  #: x, y [m], frame map
    #: places where it is or may go without asking, the next stop last; empty if it has no place
    held: tuple[int, ...] = ()
    goal: int = -1  #: place that it wants to reach; -1 for none
    since: float = 0.0  #: time at which it got the goal [s]; the longest wait has priority
    region: tuple[
        int, ...
    ] = ()  #: places around its goal that must be free when it leaves the roadmap there
    out: bool = False  #: whether it is off the roadmap, in its region; until it is back at its stop
    adopted: PlanId = NO_PLAN  #: the plan that it follows
    reached: int = (
        -1
    )  #: index of the last place reached on its path in that plan; -1 before the first
    ready: PlanId = NO_PLAN  #: the newest plan it knows; it takes no further place until it has adopted that plan
    heard: tuple[str, ...] = ()  #: robots heard recently
    plan: Plan | None = None  #: the newest plan that it made itself

    @property
    def stop(self) -> int:
        """The last place held; -1 for none."""
        return self.held[-1] if self.held else -1

    @property
    def has_taken_goal(self) -> bool:
        """Whether it may drive to its goal's place, and will have to leave the roadmap there if it has a region."""
        return self.goal >= 0 and self.stop == self.goal

    @property
    def has_arrived(self) -> bool:
        """Whether it has reached its goal's place, where it may have to leave the roadmap."""
        return self.goal >= 0 and self.held == (self.goal,)
