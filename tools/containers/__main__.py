"""``./pioneer up``, ``down``, ``status``, ``logs``, ``exec``, ``image``: the tutorial's computers as containers."""

import argparse
import functools
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from containers.engine import DESKTOP, ContainerError
from containers.image import ensure_images
from containers.plan import ROBOTS, WORLD, limits
from containers.report import follow
from containers.state import project
from containers.table import status_table
from containers.up import up


def main(words: Sequence[str]) -> int:
    """Runs one of the commands; returns the exit status."""
    options = _parser().parse_args(words)
    try:
        return int(options.run(options))
    except ContainerError as error:
        print(f"pioneer: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted; containers that run go on: ./pioneer status, ./pioneer down")
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("./pioneer", description=__doc__)
    parser.set_defaults(project=os.environ.get("PIONEER_PROJECT", "pioneer"))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_up(commands.add_parser("up", help="start the fleet, build the image first if need be; ends when robots drive"))
    down = commands.add_parser("down", help="end the fleet and remove its containers and network")
    down.set_defaults(run=_down)
    status = commands.add_parser("status", help="one line a computer: container, gateway, rules, robot, localisation")
    status.add_argument("--json", action="store_true", help="as JSON, for programs")
    status.set_defaults(run=_status)
    logs = commands.add_parser("logs", help="what the computers say: ./pioneer logs -f aadi1")
    logs.add_argument("-f", "--follow", action="store_true")
    logs.add_argument("computers", nargs="*")
    logs.set_defaults(run=_logs)
    execute = commands.add_parser("exec", help="run a command on a computer: ./pioneer exec aadi1 rostopic list")
    execute.add_argument("computer")
    execute.add_argument("command", nargs=argparse.REMAINDER)
    execute.set_defaults(run=_exec)
    image = commands.add_parser("image", help="build what up would build, and start nothing")
    image.add_argument("--desktop", action="store_true", help="the desktop's image too")
    image.set_defaults(run=_image)
    return parser


def _add_up(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--robots", type=int, help=f"robots, each on its computer, {limits()}; default: those there are, else {ROBOTS}")
    add("--world", help=f"a world of pioneer_gazebo (default: that of the fleet there is, else {WORLD})")
    add("--waypoints", type=int, default=3, help="send each robot that is started to so many places (default: 3)")
    add("--rtf", type=float, metavar="R", help="real-time factor of the world (default: 1, or less where that is more "
        "than the processors carry)")  # fmt: skip
    add("--idle", action="store_true", help="start no steps: type the tutorial's into ./pioneer exec")
    add("--desktop", action="store_true", help="with RViz of the fleet, in the browser")
    parser.set_defaults(run=up)


def _down(options: argparse.Namespace) -> int:
    project(options.project, COMPOSE_PROFILES=DESKTOP).run("down", "--remove-orphans")
    return 0


def _status(options: argparse.Namespace) -> int:
    computers = project(options.project).computers()
    if not computers:
        raise ContainerError("no fleet runs: ./pioneer up")
    latest: dict[str, dict[str, Any]] = {}
    asked = [(one, ("--settled", "--timeout", "4")) for one in computers if one.running]
    follow(asked, lambda computer, line: latest.__setitem__(computer.name, line))
    print(json.dumps({"computers": latest}) if options.json else status_table(computers, latest))
    return 0 if all(one.running for one in computers) else 1


def _logs(options: argparse.Namespace) -> int:
    words = ["-f"] if options.follow else []
    project(options.project, COMPOSE_PROFILES=DESKTOP).run("logs", *words, *options.computers)
    return 0


def _exec(options: argparse.Namespace) -> int:
    computers = {one.name: one for one in project(options.project).computers() if one.running}
    if options.computer not in computers:
        raise ContainerError(f"no computer {options.computer} runs; there are {', '.join(computers) or 'none'}")
    terminal = ["-it"] if sys.stdin.isatty() and sys.stdout.isatty() else ["-i"]
    command = options.command or ["bash"]
    return subprocess.run(
        ["docker", "exec", *terminal, computers[options.computer].container, *command], check=False
    ).returncode


def _image(options: argparse.Namespace) -> int:
    project(options.project)  # an engine that does not answer is told before anything is fetched
    ensure_images(functools.partial(print, flush=True), options.desktop)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
