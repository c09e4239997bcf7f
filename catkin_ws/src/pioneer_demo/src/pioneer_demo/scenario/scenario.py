"""A scenario: the description of a run in one file. The package's README lists the fields."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from pioneer_demo.scenario.link import Condition
from pioneer_node.core.document import DocumentError, nearest
from pioneer_node.core.fleet_file import RobotEntry, check_robots

HUB, BASE = "hub", "base station"
"""Names in faults for the hub's computer and the base station's gateway, in addition to robot names."""

NOISES = ("described", "realistic")
"""Profiles of the simulator's noise."""

Goal = tuple[float, ...]
"""x, y [m] in ``map`` and an optional heading [degrees]; without it the heading is that of the approach."""


@dataclasses.dataclass(frozen=True)
class ScenarioRobot(RobotEntry):
    """One robot, as in a fleet file, plus its goals; without goals it gets random waypoints."""

    goals: tuple[Goal, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fault:
    """One injected fault; exactly one of kill, freeze, blind, move, door and link is given."""

    at: float = 0.0  #: simulated time since the waypoints were sent [s]
    kill: str = ""  #: a robot, or ``hub``: kills all processes of its computer, restarts them after ``lasts``
    #: a robot, or ``base station``: suspends its gateway for ``lasts``, so that it forwards nothing
    freeze: str = ""
    blind: str = ""  #: a robot: its scans do not reach its computer for ``lasts``
    move: str = ""  #: a robot: moves it ``to`` another pose
    #: a wall that exists for ``lasts``: centre x, y [m], direction [degrees] and length [m]
    door: tuple[float, ...] = ()
    #: a robot: applies ``loss``, ``delay`` and ``rate`` to its computer's link for ``lasts``, in each direction
    link: str = ""
    to: tuple[float, ...] = ()  #: x, y [m], heading [degrees]
    loss: float = 0.0  #: fraction of packets lost; 1 cuts the link
    delay: float = 0.0  #: of each packet, in wall time [s]
    rate: float = 0.0  #: maximum total rate, in wall time [bit/s]; 0 for no limit
    lasts: float = math.nan  #: duration [s of simulated time]; of a move, which has none, 0
    every: float = 0.0  #: repetition period [s of simulated time]
    times: int = 1  #: total number of occurrences

    def __post_init__(self) -> None:
        """Validates the fields."""
        kinds = [
            name
            for name in ("kill", "freeze", "blind", "move", "door", "link")
            if getattr(self, name)
        ]
        if len(kinds) != 1:
            raise DocumentError(
                f"a fault has one of kill, freeze, blind, move, door and link, not {' and '.join(kinds) or 'none'}"
            )
        self._check_link()
        if len(self.door) not in (0, 4):
            raise DocumentError(f"a door is [x, y, degrees, length], not {list(self.door)}", "door")
        if len(self.to) != (3 if self.move else 0):
            raise DocumentError(
                "'move' needs 'to: [x, y, degrees]'; no other fault takes 'to'", "to"
            )
        if self.move and math.isnan(self.lasts):
            object.__setattr__(self, "lasts", 0.0)
        if math.isnan(self.lasts):
            raise DocumentError("lasts is missing: the duration of the fault [s]", "lasts")
        if not self.move and self.lasts <= 0.0:
            raise DocumentError(f"lasts must be above 0 s, not {self.lasts:g}", "lasts")
        if self.at < 0.0:
            raise DocumentError(f"at must be 0 s or more, not {self.at:g}", "at")
        if self.times < 1 or (self.times > 1 and self.every <= self.lasts):
            raise DocumentError(
                "a repeated fault needs times of 1 or more, and every above lasts", "every"
            )

    def _check_link(self) -> None:
        if bool(self.link) != any((self.loss, self.delay, self.rate)):
            raise DocumentError(
                "'link' needs one or more of loss, delay and rate, and nothing else has them",
                "link",
            )
        for name, most in (("loss", 1.0), ("delay", 60.0), ("rate", math.inf)):
            if not 0.0 <= (value := getattr(self, name)) <= most or value == math.inf:
                text = f"0 to {most:g}" if most < math.inf else "0 or more bit/s"
                raise DocumentError(f"{name} must be {text}, not {value:g}", name)

    @property
    def condition(self) -> Condition:
        """The condition that the fault imposes on the link."""
        return Condition(self.loss, self.delay, self.rate)

    @property
    def whom(self) -> str:
        """The affected robot, ``hub`` or ``base station``; empty for a door."""
        return self.kill or self.freeze or self.blind or self.move or self.link

    def __str__(self) -> str:
        if self.door:
            return f"a door at ({self.door[0]:g}, {self.door[1]:g}) is closed"
        if self.kill:
            return (
                f"the computer of {self.kill} is killed"
                if self.kill != HUB
                else "the hub is killed"
            )
        if self.link:
            return f"the link of {self.link} has {self.condition}"
        if self.freeze:
            return f"the gateway of {self.freeze} is frozen"
        return f"{self.blind} gets no scans" if self.blind else f"{self.move} is moved"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Success:
    """Success criteria of a run."""

    reached: float = 1.0  #: minimum fraction of waypoints reached by each robot
    collisions: int = 0  #: maximum per robot
    seconds: float | None = (
        None  #: maximum simulated time until all robots are done; None for no limit
    )
    localisation_error: float | None = (
        None  #: maximum 95th percentile for each robot [m]; None for no limit
    )
    closest_approach: float = 0.0  #: minimum centre distance of any two robots [m]

    def __post_init__(self) -> None:
        """Validates the fields."""
        if not 0.0 <= self.reached <= 1.0:
            raise DocumentError(
                f"reached is a share of the waypoints, 0 to 1, not {self.reached:g}", "reached"
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scenario:
    """Description of one run."""

    about: str = ""  #: its purpose, in a sentence
    world: str = "closed_maze"  #: name of a world, or a ``.world`` file with its map beside it
    robots: int | tuple[ScenarioRobot, ...] = (
        2  #: number of Pioneers at the world's initial poses, or a list of robots
    )
    waypoints: int = 3  #: random waypoints of each robot without goals
    rounds: int = 1  #: how many times a robot visits its goals
    seed: int = 1  #: seed of waypoints, sensor noise and particle filters
    #: real-time factor; 0 means as fast as possible; None chooses it by the number of processors
    real_time_factor: float | None = None
    traffic: bool = False  #: whether the robots coordinate right of way
    lockstep: bool = False  #: whether simulated time waits for the robots' nodes in each period
    navigation: str = (
        ""  #: YAML file of move_base parameters for robots without their own; empty for none
    )
    noise: str = (
        "described"  #: least noise of all robots: that of their descriptions, or ``realistic``
    )
    #: node parameters, by name in each robot's namespace (``amcl/min_particles``) or as ``/gazebo/NAME``
    parameters: dict[str, Any] = dataclasses.field(default_factory=dict)
    programs: tuple[
        str, ...
    ] = ()  #: extra command lines to run on each robot's computer; ``{robot}`` is its name
    faults: tuple[Fault, ...] = ()  #: faults to inject
    success: Success = dataclasses.field(default_factory=Success)  #: success criteria
    limit: float = 0.0  #: simulated time after which it counts as stuck [s]; 0: proportional to the route length

    def __post_init__(self) -> None:
        """Validates fields that depend on each other; assigns default names to unnamed robots."""
        if not isinstance(self.robots, int):
            object.__setattr__(self, "robots", _named(self.robots))
        if not 1 <= self.rounds <= 1000:
            raise DocumentError(f"rounds must be 1 to 1000, not {self.rounds}", "rounds")
        if self.noise not in NOISES:
            raise DocumentError(f"noise must be {' or '.join(NOISES)}, not {self.noise!r}", "noise")
        for number, fault in enumerate(self.faults):
            special = ((HUB,) if fault.kill else ()) + ((BASE,) if fault.freeze else ())
            known = (*self.names, *special)
            if fault.whom and fault.whom not in known:
                raise DocumentError(
                    f"unknown robot '{fault.whom}'; {nearest(fault.whom, known)}", "faults", number
                )
        for name in self.parameters:
            if name.startswith("/") and not name.startswith("/gazebo/"):
                raise DocumentError(
                    f"{name} is not a parameter of a robot's node or of /gazebo", "parameters", name
                )

    @property
    def names(self) -> tuple[str, ...]:
        """The robots' names."""
        if isinstance(self.robots, int):
            return tuple(f"pioneer{number}" for number in range(1, self.robots + 1))
        return tuple(robot.name for robot in self.robots)

    @property
    def entries(self) -> tuple[RobotEntry, ...]:
        """The robots as fleet file entries; empty for plain Pioneers at the world's initial poses."""
        if isinstance(self.robots, int):
            return tuple(
                RobotEntry(name, navigation=self.navigation)
                for name in self.names
                if self.navigation
            )
        return tuple(
            dataclasses.replace(one, navigation=one.navigation or self.navigation)
            for one in self.robots
        )

    @property
    def goals(self) -> tuple[tuple[Goal, ...], ...]:
        """Each robot's goals for all rounds; empty for random waypoints."""
        robots: Sequence[Any] = [()] * self.robots if isinstance(self.robots, int) else self.robots
        return tuple(robot.goals * self.rounds if robot else () for robot in robots)


def _named(robots: tuple[ScenarioRobot, ...]) -> tuple[ScenarioRobot, ...]:
    named = tuple(
        robot if robot.name else dataclasses.replace(robot, name=f"pioneer{number}")
        for number, robot in enumerate(robots, 1)
    )
    if not named:
        raise DocumentError("there must be 1 robot or more", "robots")
    try:
        check_robots(named)
    except DocumentError as error:
        raise error.within("robots") from None
    for number, robot in enumerate(named):
        for index, goal in enumerate(robot.goals):
            if len(goal) not in (2, 3) or not all(map(math.isfinite, goal)):
                text = f"a goal is [x, y] or [x, y, degrees], not {list(goal)}"
                raise DocumentError(text, "robots", number, "goals", index)
    return named
