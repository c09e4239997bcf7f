"""What the robots' coordinators tell one another."""

from dataclasses import dataclass, field
from typing import NamedTuple

from pioneer_traffic.core.geometry import Point


class PlanId(NamedTuple):
    """Plans are ordered by number, then by the name of the robot that made them."""

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
    """Who goes where after whom."""

    id: PlanId = field(default_factory=PlanId)
    #: by robot, the places it held when the plan was made
    held: dict[str, tuple[int, ...]] = field(default_factory=dict)
    paths: dict[str, tuple[int, ...]] = field(default_factory=dict)  #: by robot, places from the last one held on
    #: by robot, the places about its own that it alone may use, to leave the roadmap
    regions: dict[str, tuple[int, ...]] = field(default_factory=dict)
    waits: tuple[Wait, ...] = ()  #: an order of passing that no robot may break


@dataclass(frozen=True)
class Report:
    """State of one robot, as all others get it a few times a second."""

    robot: str  #: its name
    roadmap: int  #: signature of its roadmap; robots with another one do not take part
    position: Point  #: x, y [m], frame map
    #: places that it is at or may go to without asking, its next stop last; empty while it has no place
    held: tuple[int, ...] = ()
    goal: int = -1  #: place it wants to be at; -1 without
    since: float = 0.0  #: when it got that goal [s]; the longest wait goes first
    region: tuple[int, ...] = ()  #: places about its goal that must be free when it leaves the roadmap there
    out: bool = False  #: it is off the roadmap, within its region, until it is back at its stop
    adopted: PlanId = NO_PLAN  #: the plan it follows
    reached: int = -1  #: how much of its path in that plan it has driven: index of a place, -1 before the first
    ready: PlanId = NO_PLAN  #: the newest plan it knows. While that is not the adopted one, it takes no further place.
    heard: tuple[str, ...] = ()  #: robots it has heard lately
    plan: Plan | None = None  #: the newest plan that it has made itself

    @property
    def stop(self) -> int:
        """The last place held; -1 without."""
        return self.held[-1] if self.held else -1

    @property
    def has_arrived(self) -> bool:
        """Whether it stands at its goal, and may have to leave the roadmap there."""
        return self.goal >= 0 and self.held == (self.goal,)
