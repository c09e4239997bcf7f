"""The command line of ``./pioneer demo``."""

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from pioneer_demo.core.capacity import factor_held
from pioneer_demo.core.error import OptionError


@dataclasses.dataclass(frozen=True)
class DemoConfig:
    """What a demo is to do.

    Attributes:
        robots: how many.
        world: name of a world of pioneer_gazebo, or path of a .world file whose map has been drawn beside it.
        seed: of the waypoints, the simulator's sensor noise and the filters.
        real_time_factor: wanted; 0 is as fast as the machine can.
        processors: how many the factor was chosen for; 0 where it was asked for.
        waypoints: a robot.
        report: directory for report.json, fleet.png and the logs.
        limit: simulated time after which the fleet counts as stuck [s]; 0 is in proportion to the way.
        video: where a film of the run goes; None for none.
    """

    robots: int = 2
    world: str = "closed_maze"
    seed: int = 1
    real_time_factor: float = 1.0
    waypoints: int = 3
    report: Path = Path("demo-report")
    limit: float = 0.0
    video: Path | None = None
    processors: float = 0.0

    @property
    def choice(self) -> str:
        """One line on a factor that was chosen and is not that of real time; empty otherwise."""
        if not self.processors or self.real_time_factor >= 1.0:
            return ""
        return (
            f"Real-time factor {self.real_time_factor:g}: {self.processors:g} processors carry no more with "
            f"{self.robots} robots (--rtf R insists on another)"
        )

    @property
    def is_own_world(self) -> bool:
        """Whether the world is given by the path of a file."""
        return _is_path(self.world)

    @property
    def map_name(self) -> str:
        """Name of the world's map."""
        return _map_name(self.world)


def _is_path(world: str) -> bool:
    return "/" in world or world.endswith(".world")


def _map_name(world: str) -> str:
    return world.rpartition("/")[2].removesuffix(".world")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise OptionError(f"{message} (see ./pioneer demo --help)")


def config_from_arguments(
    arguments: Sequence[str], places: Mapping[str, int], places_elsewhere: int, processors: float
) -> DemoConfig:
    """Returns the configuration; ``--help`` prints and exits as argparse does.

    Args:
        arguments: the command line without the program's name.
        places: for each world of pioneer_gazebo that has a map, how many robots have an initial pose in it.
        places_elsewhere: how many have one in any other world.
        processors: how many there are, by which the real-time factor is chosen unless the arguments do.

    Raises:
        OptionError: an unknown option, or a value out of its range.
    """
    values = vars(_parser(list(places)).parse_args(arguments))
    wanted = values.pop("real_time_factor")
    config = DemoConfig(**values)
    if wanted is not None:
        config = dataclasses.replace(config, real_time_factor=wanted)
    check_fleet(config.robots, config.world, places, places_elsewhere)
    _check(config)
    if wanted is None:
        config = dataclasses.replace(
            config, real_time_factor=factor_held(config.robots, processors), processors=processors
        )
    return config


def check_fleet(robots: int, world: str, places: Mapping[str, int], places_elsewhere: int | None = None) -> None:
    """Sees to it that a world is known and has a place for each robot.

    Args:
        robots: how many.
        world: its name, or the path of its file.
        places: for each world that has a name, how many robots have an initial pose in it.
        places_elsewhere: how many have one in a world that is given by its file; None where no file will do.

    Raises:
        OptionError: it is not, or has not.
    """
    if world not in places and (places_elsewhere is None or not _is_path(world)):
        file = "" if places_elsewhere is None else ", or a .world file"
        raise OptionError(f"--world must be one of {', '.join(places)}{file}, not '{world}'")
    name = _map_name(world)
    most = places.get(name, places_elsewhere or 0)
    if not 1 <= robots <= most:
        raise OptionError(f"--robots must be 1 to {most} in {name}, not {robots}")


def _check(config: DemoConfig) -> None:
    for option, value in (("--world", config.world), ("--report", config.report), ("--video", config.video)):
        try:
            str(value).encode()
        except UnicodeEncodeError:
            shown = str(value).encode(errors="surrogateescape")
            raise OptionError(f"{option} must be UTF-8, not {shown!r}: ROS cannot handle other names") from None
    if not 1 <= config.waypoints <= 50:
        raise OptionError(f"--waypoints must be 1 to 50, not {config.waypoints}")
    if not 0.0 <= config.real_time_factor < float("inf"):
        raise OptionError(f"--rtf must be 0 (as fast as possible) or more, not {config.real_time_factor:g}")
    if not 0 <= config.seed < 2**31:
        raise OptionError(f"--seed must be 0 to {2**31 - 1}, not {config.seed}")
    if config.video is not None and not config.video.suffix:
        raise OptionError(f"--video must name a file such as run.mp4, not '{config.video}'")
    if not 0.0 <= config.limit < float("inf"):
        raise OptionError(f"--limit must be 0 (in proportion to the way) or more seconds, not {config.limit:g}")


def _parser(worlds: Sequence[str]) -> argparse.ArgumentParser:
    default = DemoConfig()
    parser = _Parser(
        prog="./pioneer demo",
        description="A fleet of simulated Pioneers drives to waypoints: a hub, a hub gateway with the simulator, and "
        "one ROS master and gateway a robot. Ctrl-C ends everything.",
        epilog="Exit status: 0 when every waypoint was reached without a collision, 1 when not, 2 for bad arguments, "
        "130 after Ctrl-C.",
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("--robots", type=int, default=default.robots, metavar="N", help="robots (default %(default)s)")
    add(
        "--world",
        default=default.world,
        metavar="W",
        help=f"{', '.join(worlds)}, or a .world file with its map beside it (default %(default)s)",
    )
    add("--seed", type=int, default=default.seed, metavar="S", help="of waypoints and noise (default %(default)s)")
    add("--rtf", dest="real_time_factor", type=float, metavar="R",
        help="real-time factor to hold, 0 = as fast as possible (default: 1, or less where that is more than the "
        "processors carry)")  # fmt: skip
    add("--waypoints", type=int, default=default.waypoints, metavar="K", help="a robot (default %(default)s)")
    add(
        "--report",
        type=Path,
        default=default.report,
        metavar="DIR",
        help="numbers, picture, logs (default %(default)s)",
    )
    add("--limit", type=float, default=default.limit, metavar="T",
        help="simulated seconds until a fleet counts as stuck (default: in proportion to the way)")  # fmt: skip
    add("--video", type=Path, metavar="FILE", help="a film of the run from above, mp4 (needs ffmpeg)")
    return parser
