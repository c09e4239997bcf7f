"""What ``./pioneer up`` changes in an existing fleet, decided before anything is built, written or started."""

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from containers import SOURCE
from containers.engine import Computer, ContainerError
from containers.state import BASE
from pioneer_demo.error import OptionError
from pioneer_demo.scenario.option import check_fleet, factor_held
from pioneer_demo.scenario.world_folder import places_by_world

ROBOTS, WORLD = 5, "utm_0"
"""Defaults for a new fleet."""
MOST_WAYPOINTS = 50
DOWN = "./pioneer down first"
LOCKSTEP = "lockstep"
"""Replaces the real-time factor: simulated time waits for every robot's nodes (docs/lockstep.md)."""
_STACK = SOURCE / "pioneer_gazebo_ros"


@dataclass(frozen=True)
class FleetPlan:
    """The planned state of the fleet."""

    robots: int  #: total number, including existing ones
    world: str  #: the world's name
    pace: str  #: its real-time factor, or ``lockstep``
    remark: str  #: one line if the factor is lower than expected, else empty
    idle: bool  #: whether the computers start no steps
    before: Mapping[str, Computer]  #: the fleet's existing computers, by name
    base: (
        Computer | None
    )  #: the base station if it runs; then other running computers are left alone

    @property
    def factor(self) -> float:
        """The real-time factor; 0 (as fast as possible) in lockstep."""
        return 0.0 if self.pace == LOCKSTEP else float(self.pace)

    @property
    def variables(self) -> dict[str, str]:
        """Values of the compose file's variables."""
        steps = {"PIONEER_STEPS": "idle"} if self.idle else {}
        factor = {"PIONEER_REAL_TIME_FACTOR": self.pace}
        return {"PIONEER_WORLD": self.world, "PIONEER_ROBOTS": str(self.robots), **factor, **steps}

    def starts(self, computer: str) -> bool:
        """Returns whether this call starts a computer; it starts all of them if the base station does not run."""
        return self.base is None or computer not in self.before or not self.before[computer].running

    @property
    def started(self) -> list[str]:
        """The computers that this call starts, base station first."""
        every = (BASE, *(f"aadi{number}" for number in range(1, self.robots + 1)))
        return [name for name in every if self.starts(name)]

    def joiners(self, computers: Sequence[Computer]) -> list[str]:
        """Returns the robots that the world did not start with; none if a person starts the steps."""
        if self.base is None or is_idle(self.base):
            return []
        count = int(self.base.environment["ROBOTS"])
        return [one.robot for one in computers if one.number > count]


def is_idle(computer: Computer) -> bool:
    """Returns whether a person types the computer's steps."""
    return computer.environment.get("PIONEER_ROLE") == "idle"


def places_here() -> dict[str, int]:
    """Returns, for each world in the image, the number of start places for robots."""
    worlds = _STACK / "pioneer_gazebo" / "worlds"
    found = places_by_world(
        _STACK / "pioneer_gazebo" / "map", _STACK / "pioneer_description" / "config"
    )
    return {name: count for name, count in found.items() if (worlds / f"{name}.world").is_file()}


def limits() -> str:
    """Returns the limits on the number of robots as text."""
    found = places_here()
    most = max(found.values())
    less = [f"{count} in {name}" for name, count in found.items() if count < most]
    return f"at most {most}" + (f" ({', '.join(less)})" if less else "")


def make_fleet_plan(
    options: Namespace, computers: Sequence[Computer], processors: float
) -> FleetPlan:
    """Returns the plan for the options of ``up`` and the existing computers.

    Raises:
        ContainerError: the options cannot be met; the text says why.
    """
    before = {one.name: one for one in computers}
    there = before.get(BASE)
    base = there if there and there.running else None
    most = max(
        [int(there.environment["ROBOTS"]) if there else 0, *(one.number for one in computers)]
    )
    robots = options.robots if options.robots is not None else most or ROBOTS
    world = options.world or (there.environment["WORLD"] if there else WORLD)
    _check_world(options, robots, world, base)
    if robots < most:
        raise ContainerError(f"there is a fleet of {most} robots: {DOWN}")
    if base:
        _check_steps(options, base, robots > most)
    pace, remark = choose_pace(options.rtf, robots, processors, base, robots > most)
    return FleetPlan(
        robots,
        world,
        pace,
        remark,
        options.idle or (base is not None and is_idle(base)),
        before,
        base,
    )


def _check_world(options: Namespace, robots: int, world: str, base: Computer | None) -> None:
    if base and world != base.environment["WORLD"]:
        raise ContainerError(f"a fleet runs in {base.environment['WORLD']}: {DOWN}")
    try:
        check_fleet(robots, world, places_here())
    except OptionError as error:
        raise ContainerError(str(error)) from None
    if not 0 <= options.waypoints <= MOST_WAYPOINTS:
        raise ContainerError(f"--waypoints must be 0 to {MOST_WAYPOINTS}, not {options.waypoints}")


def _check_steps(options: Namespace, base: Computer, more: bool) -> None:
    """Refuses options that would require starting or ending the steps of running computers."""
    if is_idle(base) and not options.idle and (more or not options.extras):
        raise ContainerError(f"an idle fleet runs: {DOWN}")
    if options.idle and not is_idle(base) and not more:
        raise ContainerError(f"a fleet runs whose steps are started: {DOWN}")


def choose_pace(
    rtf: float | str | None, robots: int, processors: float, base: Computer | None, more: bool
) -> tuple[str, str]:
    """Returns the world's real-time factor or ``lockstep``, taken from a running world, and a remark for the user.

    Raises:
        ContainerError: the requested pace is impossible.
    """
    running = base.environment.get("REAL_TIME_FACTOR") if base else None
    if LOCKSTEP in (rtf, running):
        if base and rtf not in (None, running):
            raise ContainerError(f"the world that runs has a real-time factor of {running}: {DOWN}")
        if base and more:
            raise ContainerError(f"a fleet in lockstep takes no more robots: {DOWN}")
        return LOCKSTEP, ""
    assert not isinstance(rtf, str), "the command line takes no other word"
    factor, remark = choose_factor(rtf, robots, processors, base)
    return f"{factor:g}", remark


def choose_factor(
    rtf: float | None, robots: int, processors: float, base: Computer | None
) -> tuple[float, str]:
    """Returns the world's real-time factor, taken from a running world, and a remark for the user.

    Raises:
        ContainerError: the requested factor is impossible.
    """
    if rtf is not None and not 0.0 <= rtf < 100.0:
        raise ContainerError(f"--rtf must be 0 (as fast as possible) or more, not {rtf:g}")
    held = factor_held(robots, processors)
    running = float(base.environment.get("REAL_TIME_FACTOR", "1")) if base else None
    if running is not None and rtf is not None and rtf != running:
        raise ContainerError(f"the world that runs has a real-time factor of {running:g}: {DOWN}")
    factor = running if running is not None else held if rtf is None else rtf
    if rtf is not None or held >= (1.0 if running is None else running):
        return factor, ""
    carry = f"{processors:g} processors sustain {robots} robots at a real-time factor of {held:g}"
    rest = (
        " (--rtf R sets another)" if running is None else f"; the world that runs has {running:g}"
    )
    return factor, carry + rest
