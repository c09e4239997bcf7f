"""``./pioneer up``, ``down``, ``logs``, ``exec``, ``image``: the tutorial's computers as containers."""

import argparse
import subprocess
import sys
from collections.abc import Sequence

from containers.engine import DESKTOP, EXTRAS, ROS2, WEB, ContainerError
from containers.fleet_plan import LOCKSTEP, ROBOTS, WORLD, limits
from containers.image import ensure_images
from containers.state import fleet, project
from containers.subcommand import Subcommands
from containers.up import up


def main(words: Sequence[str]) -> int:
    """Runs one of the commands; returns the exit status."""
    interrupted = "\ninterrupted; running containers continue: ./pioneer status, ./pioneer down\n"
    return _commands().run(words, interrupted)


def _commands() -> Subcommands:
    commands = Subcommands()
    text = "Starts the tutorial's computers as containers, after building the image; ends once all robots drive."
    _add_up(commands.add("up", up, text, "up --robots 3 --world closed_maze"))
    commands.add(
        "down",
        _down,
        "Ends the fleet of containers and removes its containers and network.",
        "down",
    )
    logs = commands.add("logs", _logs, "Prints what the computers log.", "logs -f aadi1")
    logs.add_argument("-f", "--follow", action="store_true", help="continue until Ctrl-C")
    logs.add_argument(
        "computers", nargs="*", metavar="COMPUTER", help="such as aadi1; all by default"
    )
    execute = commands.add(
        "exec", execute_on, "Runs a command on a computer of the fleet.", "exec aadi1 rostopic list"
    )
    execute.add_argument("computer", metavar="COMPUTER", help="such as aadi1 or aadiworkstation")
    execute.add_argument(
        "command",
        nargs=argparse.REMAINDER,
        metavar="COMMAND",
        help="with arguments; bash by default",
    )
    text = "Builds the image that up starts, and starts nothing."
    image = commands.add("image", _image, text, "image --desktop")
    _add_extras(
        image,
        "the desktop's image too",
        "the fleet page's image too",
        "the image of the door to ROS 2 too",
    )
    return commands


def _add_up(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--robots",
        type=int,
        help=f"robots, each on its computer, {limits()}; default: those there are, else {ROBOTS}",
    )
    add(
        "--world",
        help=f"a world of pioneer_gazebo (default: that of the fleet there is, else {WORLD})",
    )
    add(
        "--waypoints",
        type=int,
        default=3,
        help="send each robot that is started to so many places (default: 3)",
    )
    add("--rtf", type=_pace, metavar="R", help="real-time factor of the world (default: 1, or less where that is more "
        "than the processors sustain), or lockstep: time waits for every robot's nodes (docs/lockstep.md)")  # fmt: skip
    add(
        "--idle",
        action="store_true",
        help="start no steps, so that you can type them into ./pioneer exec",
    )
    _add_extras(
        parser,
        "with RViz of the fleet, in the browser",
        "with the fleet page, for this machine (docs/web.md)",
        "with the door to ROS 2, in the domain ROS_DOMAIN_ID, for this machine (docs/ros2.md)",
    )
    add(
        "--swarm",
        action="store_true",
        help="on all machines of the Docker Swarm that this one manages",
    )
    add("--registry", default="", metavar="HOST:PORT", help="from which the swarm's machines pull the image (default: "
        "one that is started on this machine)")  # fmt: skip
    add(
        "--update",
        action="store_true",
        help="in a swarm: replace the robots' image, one at a time, while they drive",
    )


def _pace(text: str) -> float | str:
    """Returns a real-time factor, or ``lockstep``."""
    try:
        return text if text == LOCKSTEP else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"a number or lockstep, not '{text}'") from None


def _add_extras(parser: argparse.ArgumentParser, desktop: str, web: str, ros2: str) -> None:
    for name, text in ((DESKTOP, desktop), (WEB, web), (ROS2, ros2)):
        parser.add_argument(
            f"--{name}", action="append_const", const=name, dest="extras", default=[], help=text
        )


def _down(options: argparse.Namespace) -> int:
    fleet(options.project, COMPOSE_PROFILES=",".join(EXTRAS)).down()
    return 0


def _logs(options: argparse.Namespace) -> int:
    fleet(options.project, COMPOSE_PROFILES=",".join(EXTRAS)).logs(
        options.follow, options.computers
    )
    return 0


def execute_on(options: argparse.Namespace) -> int:
    """Runs ``options.command`` on ``options.computer``; returns its exit status."""
    computers = {one.name: one for one in fleet(options.project).computers() if one.running}
    if options.computer not in computers:
        raise ContainerError(
            f"no computer {options.computer} runs; there are {', '.join(computers) or 'none'}"
        )
    terminal = ["-it"] if sys.stdin.isatty() and sys.stdout.isatty() else ["-i"]
    found, command = computers[options.computer], options.command or ["bash"]
    return subprocess.run(
        [*found.docker, "exec", *terminal, found.container, *command], check=False
    ).returncode


def _image(options: argparse.Namespace) -> int:
    project(options.project)  # fails early if the engine does not answer
    ensure_images(options.extras)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
