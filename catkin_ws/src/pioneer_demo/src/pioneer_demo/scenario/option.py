"""Command lines of ``./pioneer fleet``, ``demo`` and ``run-scenario``."""

import argparse
import dataclasses
import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NoReturn, Self

from pioneer_demo.error import OptionError
from pioneer_demo.scenario.scenario import NOISES, Fault, Goal, Scenario, Success
from pioneer_node.core.fleet_file import NO_NAVIGATION, RobotEntry

OBSERVER = "fleet_observer"
"""Name of the node that observes the fleet, and of its ring in lockstep."""
_ROBOTS_A_PROCESSOR = 6.75
"""Robots, with navigation and gateway, that one processor runs in real time (docs/performance.md)."""
_TRAFFIC_COST, _TRAFFIC_COST_OF_OTHERS = 0.02, 0.002
"""What right of way costs a robot, and what it costs it for each robot of the fleet [processors] (docs/traffic.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FleetConfig:
    """Configuration of a fleet."""

    restarts_nodes: ClassVar = True  #: whether launch files may respawn dead nodes
    robots: int = 2  #: number of robots
    #: name of a world of pioneer_gazebo, or path of a .world file with its map beside it
    world: str = "closed_maze"
    seed: int = (
        1  #: seed of the simulator's sensor noise, the particle filters and a demo's waypoints
    )
    real_time_factor: float = 1.0  #: target factor; 0 means as fast as possible
    processors: float = 0.0  #: number of processors the factor was chosen for; 0 if it was given
    log: Path = Path("fleet-log")  #: directory for the logs of all processes
    fleet: Path | None = None  #: fleet file that describes the robots; None for Pioneers
    names: tuple[str, ...] = ("pioneer1", "pioneer2")  #: the robots' names, in order
    #: those of ``names`` that another navigation drives: they have no amcl, move_base and waypoint client
    external: tuple[str, ...] = ()
    traffic: bool = False  #: whether the robots coordinate right of way
    #: why several robots do not, although nobody switched it off; empty if they do, or were not to
    traffic_refusal: str = ""
    record: Path | None = None  #: file for a recording of all masters' topics; None for none
    #: patterns for the names of the recorded topics; empty for all
    record_topics: tuple[str, ...] = ()
    record_split: int = 0  #: size at which the recording continues in a new file [MB]; 0 for never
    force: bool = False  #: whether the recording may replace a file
    web: bool = False  #: whether to serve the web dashboard
    token: str = ""  #: login token of the dashboard
    ros2: bool = False  #: whether to open the door to ROS 2
    entries: tuple[RobotEntry, ...] = ()  #: the robots of a scenario; written as the fleet file
    noise: str = "described"  #: least noise of all robots, one of ``NOISES``
    #: node parameters, by name in each robot's namespace or as ``/gazebo/NAME``
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    programs: tuple[
        str, ...
    ] = ()  #: extra command lines to run on each robot's computer; ``{robot}`` is its name
    faults: tuple[Fault, ...] = ()  #: faults to inject into a demo
    lockstep: bool = False  #: whether simulated time waits for the robots' nodes in each period; implies factor 0

    @property
    def choice(self) -> str:
        """One line about an automatically chosen factor below 1; empty otherwise."""
        if not self.processors or self.real_time_factor >= 1.0:
            return ""
        without = factor_held(self.robots, self.processors)
        more = f" and right of way (--no-traffic: {without:g})" if self.traffic else ""
        return (
            f"Real-time factor {self.real_time_factor:g}: {self.processors:g} processors sustain no more with "
            f"{self.robots} robots{more} (--rtf R sets another)"
        )

    @property
    def traffic_line(self) -> str:
        """One line about right of way that is off for a reason; empty otherwise."""
        if not self.traffic_refusal:
            return ""
        return f"Right of way is off: {self.traffic_refusal} (docs/traffic.md)"

    @property
    def rings(self) -> tuple[str, ...]:
        """The rings that lockstep waits for; empty for the robots' rings only."""
        return ()

    @property
    def is_own_world(self) -> bool:
        """Whether the world is given as a file path."""
        return _is_path(self.world)

    @property
    def map_name(self) -> str:
        """Name of the world's map."""
        return _map_name(self.world)

    @property
    def linked(self) -> tuple[str, ...]:
        """The robots whose links have faults."""
        return tuple(dict.fromkeys(fault.link for fault in self.faults if fault.link))

    @property
    def output(self) -> tuple[str, Path]:
        """The output folder, with its option."""
        return "--log", self.log

    @property
    def has_default_output(self) -> bool:
        """Whether the output folder is the command's own, which nobody has chosen."""
        return self.output == type(self)().output

    def with_output(self, folder: Path) -> Self:
        """Returns the same fleet with another output folder."""
        return dataclasses.replace(self, log=folder)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DemoConfig(FleetConfig):
    """Configuration of a demo."""

    restarts_nodes: ClassVar = False  #: the death of a node is a fault
    waypoints: int = 3  #: waypoints per robot
    report: Path = Path("demo-report")  #: directory for report.json, fleet.png and the logs
    log: Path = Path("demo-report/log")
    limit: float = 0.0  #: simulated time after which the fleet counts as stuck [s]; 0: proportional to the route length
    video: Path | None = None  #: video file; None for none
    goals: tuple[tuple[Goal, ...], ...] = ()  #: goals of each robot; empty for random waypoints
    success: Success = dataclasses.field(default_factory=Success)  #: success criteria
    scenario: Path | None = None  #: scenario file; None if configured on the command line

    @property
    def rings(self) -> tuple[str, ...]:
        """The rings that lockstep waits for; empty for the robots' rings only."""
        return (OBSERVER, *self.names) if self.lockstep else ()

    @property
    def output(self) -> tuple[str, Path]:
        """The output folder, with its option."""
        return "--report", self.report

    def with_output(self, folder: Path) -> Self:
        """Returns the same demo with another output folder."""
        log = folder / "log"
        fleet = _written_fleet(log) if self.entries else self.fleet
        return dataclasses.replace(self, report=folder, log=log, fleet=fleet)


def _written_fleet(log: Path) -> Path:
    """Returns the path of the fleet file that a scenario's run writes."""
    return (log / "fleet.yaml").absolute()


def _is_path(world: str) -> bool:
    return "/" in world or world.endswith(".world")


def _map_name(world: str) -> str:
    return world.rpartition("/")[2].removesuffix(".world")


class Parser(argparse.ArgumentParser):
    """Argument parser of a command that raises errors as `OptionError`."""

    def __init__(self, command: str, description: str, epilog: str) -> None:
        super().__init__(
            f"./pioneer {command}",
            description=description,
            epilog=epilog,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def error(self, message: str) -> NoReturn:
        """Raises `OptionError`."""
        raise OptionError(f"{message} (see {self.prog} --help)")


@dataclasses.dataclass(frozen=True)
class Machine:
    """Facts about this machine and workspace that the options depend on."""

    #: number of initial poses in each world of pioneer_gazebo that has a map
    places: Mapping[str, int]
    places_elsewhere: int  #: number of initial poses in any other world
    processors: float  #: number of processors, which determines the default real-time factor
    names_of: Callable[[Path], Sequence[str]] = (
        lambda _: ()
    )  #: returns the names of the robots in a fleet file
    #: reads a scenario's file; raises OptionError if it is invalid
    scenario_of: Callable[[Path], Scenario] = lambda _: Scenario()
    #: returns the names of the robots in a fleet file that another navigation drives
    external_of: Callable[[Path], Sequence[str]] = lambda _: ()
    #: why runs in lockstep are impossible here; empty if they are not
    lockstep_refusal: str = ""
    #: returns why a fleet cannot keep the right of way; its arguments: fleet file or None, names, world
    traffic_refusal: Callable[[Path | None, Sequence[str], str], str] = lambda *_: ""


def demo_config(arguments: Sequence[str], machine: Machine) -> DemoConfig:
    """Returns the configuration of ``./pioneer demo``; ``--help`` prints and exits as argparse does.

    Raises:
        OptionError: an unknown option, or a value out of its range.
    """
    values = vars(_demo_parser(list(machine.places)).parse_args(arguments))
    config = DemoConfig(**_chosen(values, machine), log=values["report"] / "log")
    _check_demo(config)
    return config


def fleet_config(arguments: Sequence[str], machine: Machine) -> FleetConfig:
    """Returns the configuration of ``./pioneer fleet``; see `demo_config`."""
    return FleetConfig(
        **_chosen(vars(_fleet_parser(list(machine.places)).parse_args(arguments)), machine)
    )


def scenario_config(arguments: Sequence[str], machine: Machine) -> DemoConfig:
    """Returns the configuration of ``./pioneer run-scenario``: options override the scenario file."""
    given = vars(_scenario_parser().parse_args(arguments))
    file, log = given.pop("scenario"), given["report"] / "log"
    said = machine.scenario_of(file)
    count = said.robots if isinstance(said.robots, int) else len(said.robots)
    overridden = ("seed", "real_time_factor")
    options = {
        name: given.pop(name) if given[name] is not None else getattr(said, name)
        for name in overridden
    }
    given["lockstep"] = given["lockstep"] or said.lockstep
    if given["lockstep"]:
        options["real_time_factor"] = None
    fields = ("world", "waypoints", "traffic", "limit", "noise")
    values = {
        **given,
        **options,
        **{name: getattr(said, name) for name in fields},
        "robots": count,
        "fleet": None,
    }
    # Right of way is what the file says, so that results stay comparable.
    as_said = dataclasses.replace(machine, traffic_refusal=lambda *_: "")
    chosen: dict[str, Any] = {**_chosen(values, as_said), "names": said.names}
    if said.entries:
        chosen |= {"entries": said.entries, "fleet": _written_fleet(log)}
    extras = {
        name: getattr(said, name)
        for name in ("parameters", "programs", "goals", "faults", "success")
    }
    config = DemoConfig(**chosen, **extras, log=log, scenario=file)
    if config.linked and config.lockstep:
        raise OptionError(f"--lockstep: {file} has faults of links, whose figures are of wall time")
    if config.linked and config.record:
        raise OptionError("--record: the robots' masters cannot be reached where links have faults")
    _check_demo(config)
    return config


CONFIGS = {"demo": demo_config, "fleet": fleet_config, "run-scenario": scenario_config}
"""Configuration function of each command."""


def _chosen(values: dict[str, Any], machine: Machine) -> dict[str, Any]:
    """Returns the checked values; a missing real-time factor is chosen by the number of processors."""
    _check(values)
    values["record_topics"] = tuple(values["record_topics"])
    count, file = values["robots"], values["fleet"]
    if file is None:
        count = FleetConfig().robots if count is None else count
        values["names"] = tuple(f"pioneer{number}" for number in range(1, count + 1))
    elif count is not None:
        raise OptionError(
            "--robots and --fleet both say how many robots there are: give one of them"
        )
    else:
        values["fleet"], values["names"] = (
            file.expanduser().resolve(),
            tuple(machine.names_of(file.expanduser())),
        )
        values["external"] = tuple(machine.external_of(file.expanduser()))
        count = len(values["names"])
    values["robots"] = count
    check_fleet(count, values["world"], machine.places, machine.places_elsewhere)
    values |= _right_of_way(values, machine)
    if values["lockstep"]:
        if machine.lockstep_refusal:
            raise OptionError(f"--lockstep: {machine.lockstep_refusal}")
        return {**values, "real_time_factor": 0.0}
    if values["real_time_factor"] is None:
        factor = factor_held(values["robots"], machine.processors, traffic=values["traffic"])
        return {**values, "real_time_factor": factor, "processors": machine.processors}
    return values


def _right_of_way(values: Mapping[str, Any], machine: Machine) -> dict[str, Any]:
    """Returns whether the robots keep the right of way: by default if there are several, and they can.

    Raises:
        OptionError: it is demanded, and impossible.
    """
    demanded, count = values["traffic"], values["robots"]
    if demanded is False or (demanded is None and count < 2):
        return {"traffic": bool(demanded)}
    refusal = (
        machine.traffic_refusal(values["fleet"], values["names"], values["world"])
        if count > 1
        else ""
    )
    if demanded and refusal:
        raise OptionError(f"--traffic: {refusal}")
    return {"traffic": not refusal, "traffic_refusal": refusal}


def factor_held(robots: int, processors: float, *, traffic: bool = False) -> float:
    """Returns the real-time factor at which navigation keeps up, rounded down to a multiple of 0.05; at most 1.

    Args:
        robots: number of robots.
        processors: number of processors.
        traffic: whether the robots keep the right of way: each receives the reports of all others.
    """
    at_once = _ROBOTS_A_PROCESSOR
    if traffic:
        cost = _TRAFFIC_COST + _TRAFFIC_COST_OF_OTHERS * robots
        at_once /= 1.0 + _ROBOTS_A_PROCESSOR * cost
    return min(1.0, max(0.05, math.floor(20 * at_once * processors / robots) / 20))


def check_fleet(
    robots: int, world: str, places: Mapping[str, int], places_elsewhere: int | None = None
) -> None:
    """Checks that a world is known and has a place for each robot.

    Args:
        robots: number of robots.
        world: its name, or the path of its file.
        places: number of initial poses in each named world.
        places_elsewhere: number of initial poses in a world given by its file; None if files are not accepted.

    Raises:
        OptionError: the world is unknown or has too few initial poses.
    """
    if world not in places and (places_elsewhere is None or not _is_path(world)):
        file = "" if places_elsewhere is None else ", or a .world file"
        near = difflib.get_close_matches(world, places, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise OptionError(f"--world must be one of {', '.join(places)}{file}, not '{world}'{hint}")
    name = _map_name(world)
    most = places.get(name, places_elsewhere or 0)
    if not 1 <= robots <= most:
        raise OptionError(f"--robots must be 1 to {most} in {name}, not {robots}")


def _check(values: Mapping[str, Any]) -> None:
    for name in ("world", "log", "report", "video", "fleet", "record"):
        try:
            str(values.get(name, "")).encode()
        except UnicodeEncodeError:
            shown = str(values[name]).encode(errors="surrogateescape")
            raise OptionError(
                f"--{name} must be UTF-8, not {shown!r}: ROS cannot handle other names"
            ) from None
    record = values["record"]
    if record is not None and record.suffix not in (".mcap", ".bag"):
        raise OptionError(f"--record must name a file such as run.mcap or run.bag, not '{record}'")
    if values["record_split"] < 0:
        raise OptionError(
            f"--record-split must be 0 (one file) or more, not {values['record_split']}"
        )
    if record is None and (values["record_topics"] or values["record_split"]):
        raise OptionError("--record-topics and --record-split go with --record FILE")
    factor = values["real_time_factor"]
    if factor is not None and not 0.0 <= factor < float("inf"):
        raise OptionError(f"--rtf must be 0 (as fast as possible) or more, not {factor:g}")
    if values["lockstep"] and factor is not None:
        raise OptionError("--rtf and --lockstep both say how fast time passes: give one of them")
    if not 0 <= values["seed"] < 2**31:
        raise OptionError(f"--seed must be 0 to {2**31 - 1}, not {values['seed']}")


def _check_demo(config: DemoConfig) -> None:
    entries = (entry.name for entry in config.entries if entry.navigation == NO_NAVIGATION)
    for name in (*config.external, *entries):
        raise OptionError(
            f"{name} has 'navigation: none', but a demo sends waypoints to every robot"
        )
    if not 1 <= config.waypoints <= 50:
        raise OptionError(f"--waypoints must be 1 to 50, not {config.waypoints}")
    if config.video is not None and not config.video.suffix:
        raise OptionError(f"--video must name a file such as run.mp4, not '{config.video}'")
    if not 0.0 <= config.limit < float("inf"):
        raise OptionError(
            f"--limit must be 0 (in proportion to the way) or more seconds, not {config.limit:g}"
        )


def _add_common(parser: Parser, worlds: Sequence[str]) -> None:
    """Adds the options common to all fleets."""
    default, add = FleetConfig(), parser.add_argument
    add("--robots", type=int, metavar="N", help=f"robots (default {default.robots})")
    add(
        "--fleet",
        type=Path,
        metavar="FILE",
        help="fleet file: robots of different kinds (pioneer_demo's README)",
    )
    add("--world", default=default.world, metavar="W",
        help=f"{', '.join(worlds)}, or a .world file with its map beside it (default %(default)s)")  # fmt: skip
    add("--seed", type=int, default=default.seed, metavar="S",
        help="of sensor noise, filters and a demo's waypoints (default %(default)s)")  # fmt: skip
    add("--noise", choices=NOISES, default=default.noise,
        help="least noise of all robots: that of their descriptions, where encoders are perfect, or realistic noise "
        "(pioneer_gazebo's README)")  # fmt: skip
    add("--rtf", dest="real_time_factor", type=float, metavar="R",
        help="real-time factor to hold, 0 = as fast as possible (default: 1, or less where that is more than the "
        "processors sustain)")  # fmt: skip
    add("--lockstep", action="store_true",
        help="time waits for every robot's nodes: as fast as the machine can, and the same run for the same seed "
        "(docs/lockstep.md)")  # fmt: skip
    add("--traffic", action=argparse.BooleanOptionalAction,
        help="the robots keep the right of way with one another (docs/traffic.md; default: if there are several, and "
        "map and footprints allow it)")  # fmt: skip
    _add_record(parser)
    add(
        "--web",
        action="store_true",
        help="serve the fleet in the browser, on this machine only (docs/web.md)",
    )
    add(
        "--ros2",
        action="store_true",
        help="open the fleet to ROS 2 in the domain ROS_DOMAIN_ID, on this machine only (docs/ros2.md)",
    )


def _add_record(parser: Parser) -> None:
    parser.add_argument("--record", type=Path, metavar="FILE",
        help="record the topics of all masters, .mcap or .bag (./pioneer replay FILE)")  # fmt: skip
    parser.add_argument("--record-topics", nargs="+", default=(), metavar="NAME",
        help="record only these, such as /clock '/tf*' '/aadi1/*'")  # fmt: skip
    parser.add_argument("--record-split", type=int, default=0, metavar="MB",
        help="continue the recording in NAME-2, NAME-3, … whenever a file has this size")  # fmt: skip
    parser.add_argument("--force", action="store_true", help="let --record replace a file")


def _fleet_parser(worlds: Sequence[str]) -> Parser:
    parser = Parser(
        "fleet",
        "Starts a fleet of simulated Pioneers on this machine and keeps it up: a hub, a hub gateway with\n"
        "the simulator, and one ROS master, gateway and navigation a robot. Ctrl-C ends everything.",
        "Meanwhile, in other terminals:\n"
        "  ./pioneer status              one line a robot\n"
        "  ./pioneer rviz                RViz of the fleet\n"
        "  ./pioneer teleop pioneer1     drive a robot by keyboard\n"
        "Example: ./pioneer fleet --robots 5 --world utm_0",
    )
    _add_common(parser, worlds)
    parser.add_argument(
        "--log",
        type=Path,
        default=FleetConfig().log,
        metavar="DIR",
        help="logs (default %(default)s)",
    )
    return parser


def _scenario_parser() -> Parser:
    parser = Parser(
        "run-scenario",
        "Runs what a scenario's file describes: world, robots, tasks, faults, and what counts as success.\n"
        "FILE is a path, or the name of one that pioneer_demo ships in scenarios/.",
        "Exit status: 0 for a success, 1 for none, 2 for a wrong file or option, 130 after Ctrl-C.\n"
        "Example: ./pioneer run-scenario doorway",
    )
    add = parser.add_argument
    add(
        "scenario",
        type=Path,
        metavar="FILE",
        help="the scenario (pioneer_demo's README has its fields)",
    )
    add("--seed", type=int, metavar="S", help="instead of the file's")
    add("--rtf", dest="real_time_factor", type=float, metavar="R", help="instead of the file's")
    _add_record(parser)
    add(
        "--lockstep",
        action="store_true",
        help="instead of the file's factor: time waits for every robot's nodes",
    )
    _add_outputs(parser)
    return parser


def _add_outputs(parser: Parser) -> None:
    """Adds the options for a run's outputs."""
    add = parser.add_argument
    add("--report", type=Path, default=DemoConfig().report, metavar="DIR",
        help="numbers, picture, logs (default %(default)s)")  # fmt: skip
    add(
        "--video",
        type=Path,
        metavar="FILE",
        help="a film of the run from above, mp4 (needs ffmpeg)",
    )


def _demo_parser(worlds: Sequence[str]) -> Parser:
    default = DemoConfig()
    parser = Parser(
        "demo",
        "Starts a fleet as ./pioneer fleet does, sends every robot to waypoints, and reports how it went.\n"
        "Ctrl-C ends everything.",
        "Exit status: 0 when every waypoint was reached without a collision, 1 when not, 2 for bad arguments,\n"
        "130 after Ctrl-C.\n"
        "Example: ./pioneer demo --robots 5 --world utm_0 --video run.mp4",
    )
    _add_common(parser, worlds)
    add = parser.add_argument
    add(
        "--waypoints",
        type=int,
        default=default.waypoints,
        metavar="K",
        help="a robot (default %(default)s)",
    )
    add("--limit", type=float, default=default.limit, metavar="T",
        help="simulated seconds until a fleet counts as stuck (default: in proportion to the way)")  # fmt: skip
    _add_outputs(parser)
    return parser
