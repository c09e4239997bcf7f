"""``./pioneer up``, ``down``, ``status``, ``logs``, ``exec``: the tutorial's computers as containers."""

import argparse
import os
import secrets
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from containers import image
from containers.engine import Computer, ContainerError, Project, compose_command, output
from containers.layout import write_compose
from containers.report import follow
from containers.table import progress_line, status_table

ROOT = Path(__file__).resolve().parent.parent.parent
STATE = ROOT / ".setup" / "containers"
BASE = "aadiworkstation"
START_UP, START_UP_PER_ROBOT = 120.0, 10.0


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
    up = commands.add_parser("up", help="start the fleet, build the image first if need be; ends when robots drive")
    up.add_argument("--robots", type=int, default=5, help="robots, each on its computer (default: %(default)s)")
    up.add_argument("--world", default="utm_0", help="a world of pioneer_gazebo (default: %(default)s)")
    up.add_argument("--waypoints", type=int, default=3, help="send each robot to so many places (default: %(default)s)")
    up.add_argument("--idle", action="store_true", help="start no steps: type the tutorial's into ./pioneer exec")
    up.set_defaults(run=_up)
    down = commands.add_parser("down", help="end the fleet and remove its containers and network")
    down.set_defaults(run=lambda options: _project(options).run("down", "--remove-orphans") or 0)
    status = commands.add_parser("status", help="one line a computer: container, gateway, rules, robot, localisation")
    status.set_defaults(run=_status)
    logs = commands.add_parser("logs", help="what the computers say: ./pioneer logs -f aadi1")
    logs.add_argument("-f", "--follow", action="store_true")
    logs.add_argument("computers", nargs="*")
    logs.set_defaults(run=_logs)
    execute = commands.add_parser("exec", help="run a command on a computer: ./pioneer exec aadi1 rostopic list")
    execute.add_argument("computer")
    execute.add_argument("command", nargs=argparse.REMAINDER)
    execute.set_defaults(run=_exec)
    return parser


def _project(options: argparse.Namespace, **variables: str) -> Project:
    """Returns the project as it stands on disk; the shipped file where no fleet was started yet."""
    written = STATE / options.project / "compose.yaml"
    shipped = ROOT / "docker" / "compose.yaml"
    file = written if written.is_file() else shipped
    password = {"PIONEER_HUB_PASSWORD_FILE": str(hub_password())}
    return Project(options.project, tuple(compose_command()), file, {**password, **variables})


def hub_password() -> Path:
    """Returns the file with the hub's password, which is made at the first call."""
    path = STATE / "hub-password"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(mode=0o600)
        path.write_text(secrets.token_urlsafe(24) + "\n")
    return path


def _up(options: argparse.Namespace) -> int:
    began = time.monotonic()
    _project(options)  # an engine that does not answer is told before anything is built
    write_compose(ROOT / "docker" / "compose.yaml", STATE / options.project / "compose.yaml", options.robots)
    running = {one.name: one for one in _project(options).computers() if one.running}
    base = running.get(BASE)
    robots = int(base.environment["ROBOTS"]) if base else options.robots
    world = base.environment["WORLD"] if base else options.world
    if base and world != options.world:
        raise ContainerError(f"a fleet runs in {world}: ./pioneer down first")
    if not base and "PIONEER_IMAGE" not in os.environ:
        image.ensure_image("pioneer", _say)
    steps = {"PIONEER_STEPS": "idle"} if options.idle else {}
    project = _project(options, PIONEER_WORLD=world, PIONEER_ROBOTS=str(robots), **steps)
    built = time.monotonic()
    # What runs is left alone, so that more robots can join.
    project.run("up", "-d", *(["--no-recreate"] if base else []))
    computers = project.computers()
    if base:
        _join(base, [one.robot for one in computers if one.robot and one.name not in running and one.number > robots])
    if options.idle:
        _say(f"{len(computers)} computers are up and idle: ./pioneer exec {BASE}, ./pioneer exec aadi1, …")
        return 0
    return _await(computers, options, built - began, built)


def _join(base: Computer, robots: Sequence[str]) -> None:
    """Puts more robots into a running world, and what RViz shows of them onto the base station."""
    for robot in robots:
        pose = " ".join(f"-{option} $(rosparam get /{robot}/{key})" for option, key in zip("xyY", "xya", strict=True))
        launch = f'exec roslaunch pioneer_description generic_pioneer.launch name:={robot} pose:="{pose}"'
        output("docker", "exec", "-d", base.container, "bash", "-c", f"{launch} >/proc/1/fd/1 2>&1")
    if robots:
        output(
            "docker",
            "exec",
            base.container,
            "rosrun",
            "rocon_flip",
            "flip-from-hub",
            robots[-1].removeprefix("pioneer"),
        )


def _await(computers: Sequence[Computer], options: argparse.Namespace, image_seconds: float, started: float) -> int:
    until = "moving" if options.waypoints else "ready"
    timeout = START_UP + START_UP_PER_ROBOT * options.robots
    words = ["--until", until, "--timeout", f"{timeout:g}", "--waypoints", str(options.waypoints)]
    latest: dict[str, dict[str, Any]] = {}

    def heard(computer: Computer, line: dict[str, Any]) -> None:
        latest[computer.name] = line
        _say(f"{time.monotonic() - started:5.1f} s  {progress_line(computer.name, line)}")

    came = follow(computers, [*words, "--robots", str(options.robots)], heard)
    seconds = time.monotonic() - started
    late = sorted(name for name, well in came.items() if not well)
    if late:
        for name in late:
            print(f"{name}: {latest.get(name, {}).get('lacks') or 'does not move'}", file=sys.stderr)
        raise ContainerError(f"{', '.join(late)} not {until} after {seconds:.0f} s; ./pioneer logs {late[0]} has more")
    built = f", after {image_seconds:.0f} s for the image" if image_seconds > 5 else ""
    _say(f"{len(computers) - 1} robots {'drive' if options.waypoints else 'are ready'} after {seconds:.0f} s{built}")
    return 0


def _status(options: argparse.Namespace) -> int:
    computers = _project(options).computers()
    if not computers:
        raise ContainerError("no fleet runs: ./pioneer up")
    latest: dict[str, dict[str, Any]] = {}
    running = [one for one in computers if one.running]
    follow(running, ["--settled", "--timeout", "4"], lambda computer, line: latest.__setitem__(computer.name, line))
    print(status_table(computers, latest))
    return 0 if all(one.running for one in computers) else 1


def _logs(options: argparse.Namespace) -> int:
    _project(options).run("logs", *(["-f"] if options.follow else []), *options.computers)
    return 0


def _exec(options: argparse.Namespace) -> int:
    computers = {one.name: one for one in _project(options).computers() if one.running}
    if options.computer not in computers:
        raise ContainerError(f"no computer {options.computer} runs; there are {', '.join(computers) or 'none'}")
    terminal = ["-it"] if sys.stdin.isatty() and sys.stdout.isatty() else ["-i"]
    command = options.command or ["bash"]
    return subprocess.run(
        ["docker", "exec", *terminal, computers[options.computer].container, *command], check=False
    ).returncode


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
