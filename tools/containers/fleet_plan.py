"""What ``./pioneer up`` does with an existing fleet: decided before anything is built, written or started."""

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from containers import SOURCE
from containers.engine import Computer, ContainerError
from containers.state import BASE
from pioneer_demo.adapters.world_folder import places_by_world
from pioneer_demo.core.capacity import factor_held
from pioneer_demo.core.error import OptionError
from pioneer_demo.core.option import check_fleet

ROBOTS, WORLD = 5, "utm_0"
"""Of a new fleet, unless options say otherwise."""
MOST_WAYPOINTS = 50
DOWN = "./pioneer down first"
LOCKSTEP = "lockstep"
"""In the place of a real-time factor: simulated time waits for every robot's nodes (docs/lockstep.md)."""
_STACK = SOURCE / "pioneer_gazebo_ros"


@dataclass(frozen=True)
class FleetPlan:
    """The fleet as it is to be."""

    robots: int  #: how many, with those there are
    world: str  #: the world's name
    pace: str  #: its real-time factor, or ``lockstep``
    remark: str  #: one line on a factor that is less than was to be expected; empty otherwise
    idle: bool  #: no steps are started
    before: Mapping[str, Computer]  #: the fleet's computers as they were, by name
    base: Computer | None  #: the base station if it runs: what runs with it is left alone

    @property
    def factor(self) -> float:
        """The real-time factor; 0, as fast as possible, in lockstep."""
        return 0.0 if self.pace == LOCKSTEP else float(self.pace)

    def starts(self, computer: str) -> bool:
        """Returns whether a computer is started by this call: all are where the base station does not run."""
        return self.base is None or computer not in self.before or not self.before[computer].running

    @property
    def started(self) -> list[str]:
        """The computers that this call starts, the base station first."""
        every = (BASE, *(f"aadi{number}" for number in range(1, self.robots + 1)))
        return [name for name in every if self.starts(name)]

    def joiners(self, computers: Sequence[Computer]) -> list[str]:
        """Returns the robots that the base station's world did not begin with; none where a person starts it."""
        if self.base is None or is_idle(self.base):
            return []
        count = int(self.base.environment["ROBOTS"])
        return [one.robot for one in computers if one.number > count]


def is_idle(computer: Computer) -> bool:
    """Returns whether a person types its steps."""
    return computer.environment.get("PIONEER_ROLE") == "idle"


def places_here() -> dict[str, int]:
    """Returns for each world that comes with the image how many robots have a place in it."""
    worlds = _STACK / "pioneer_gazebo" / "worlds"
    found = places_by_world(_STACK / "pioneer_gazebo" / "map", _STACK / "pioneer_description" / "config")
    return {name: count for name, count in found.items() if (worlds / f"{name}.world").is_file()}


def limits() -> str:
    """Returns in words how many robots there can be."""
    found = places_here()
    most = max(found.values())
    less = [f"{count} in {name}" for name, count in found.items() if count < most]
    return f"at most {most}" + (f" ({', '.join(less)})" if less else "")


def make_fleet_plan(options: Namespace, computers: Sequence[Computer], processors: float) -> FleetPlan:
    """Returns the plan for the options of ``up`` and the computers that are there.

    Raises:
        ContainerError: it cannot be, and why.
    """
    before = {one.name: one for one in computers}
    there = before.get(BASE)
    base = there if there and there.running else None
    most = max([int(there.environment["ROBOTS"]) if there else 0, *(one.number for one in computers)])
    robots = options.robots if options.robots is not None else most or ROBOTS
    world = options.world or (there.environment["WORLD"] if there else WORLD)
    _check_world(options, robots, world, base)
    if robots < most:
        raise ContainerError(f"there is a fleet of {most} robots: {DOWN}")
    if base:
        _check_steps(options, base, robots > most)
    pace, remark = choose_pace(options.rtf, robots, processors, base, robots > most)
    return FleetPlan(robots, world, pace, remark, options.idle or (base is not None and is_idle(base)), before, base)


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
    """Refuses what would need the steps of computers that run started, or ended."""
    if is_idle(base) and not options.idle and (more or not options.extras):
        raise ContainerError(f"an idle fleet runs: {DOWN}")
    if options.idle and not is_idle(base) and not more:
        raise ContainerError(f"a fleet runs whose steps are started: {DOWN}")


def choose_pace(
    rtf: float | str | None, robots: int, processors: float, base: Computer | None, more: bool
) -> tuple[str, str]:
    """Returns the world's real-time factor or ``lockstep``, as the running one has it, and what to say of it.

    Raises:
        ContainerError: what was asked for cannot be.
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


def choose_factor(rtf: float | None, robots: int, processors: float, base: Computer | None) -> tuple[float, str]:
    """Returns the factor that the world is to have, that of the running one if there is one, and what to say of it.

    Raises:
        ContainerError: the factor that was asked for cannot be.
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
    carry = f"{processors:g} processors carry {robots} robots at a real-time factor of {held:g}"
    rest = " (--rtf R sets another)" if running is None else f"; the world that runs has {running:g}"
    return factor, carry + rest
