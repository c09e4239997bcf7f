"""``./pioneer status``, ``rviz`` and ``teleop``: find the running fleet, either processes or containers."""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import containers
from containers.engine import Computer, ContainerError
from containers.report import aligned, follow, status_table
from containers.state import fleet as fleet_of
from containers.state import stack
from containers.subcommand import Subcommands
from pioneer_fleet.printable import printable
from pioneer_fleet.registry import running_fleets

HEADINGS = ("ROBOT", "STATE", "ROBOT MOVES", "ODOM", "POSITION", "ERROR", "WAYPOINTS", "LAST WORD")
STALE = 5.0
"""Age from which a fleet's figures are said to be old [s]; its command writes them each second."""
Fleet = Mapping[str, Any]


def main(words: Sequence[str]) -> int:
    """Runs one of the commands; returns the exit status."""
    commands = Subcommands()
    text = "Shows the fleets that run on this machine, as processes or as containers: a line a robot or computer."
    status = commands.add("status", _status, text, "status --json")
    status.add_argument("--json", action="store_true", help="as JSON, for programs")
    rviz = commands.add(
        "rviz", _rviz, "Opens RViz on the fleet that runs on this machine as processes.", "rviz"
    )
    text = (
        "Drives a robot by keyboard; the fleet runs on this machine, as processes or as containers."
    )
    teleop = commands.add("teleop", _teleop, text, "teleop pioneer1")
    teleop.add_argument("robot", help="its name, such as pioneer1")
    for command in (status, rviz, teleop):
        command.add_argument(
            "--fleet", type=int, metavar="PID", help="the fleet of this process, if several run"
        )
    return commands.run(words)


def _status(options: argparse.Namespace) -> int:
    fleets: Sequence[Fleet] = running_fleets()
    computers = list[Computer]()
    latest: dict[str, dict[str, Any]] = {}
    if options.fleet is not None:
        fleets = [_chosen(fleets, options.fleet)]
    elif _has_containers(options.project):
        computers = fleet_of(options.project).computers()
        asked = [(one, ("--settled", "--timeout", "4")) for one in computers if one.running]
        follow(asked, lambda computer, line: latest.__setitem__(computer.name, line))
    if not fleets and not computers:
        raise ContainerError(
            "no fleet runs: ./pioneer fleet starts one as processes, ./pioneer up as containers"
        )
    if options.json:
        for one in computers:
            if one.node:
                latest.setdefault(one.name, {"lacks": one.problem or one.state})["node"] = one.node
        print(json.dumps({"fleets": fleets, "computers": latest}))
    else:
        print(
            "\n\n".join(
                [
                    *map(fleet_table, fleets),
                    *([status_table(computers, latest)] if computers else []),
                ]
            )
        )
    are_well = all(fleet["age"] <= STALE and not fleet["faults"] for fleet in fleets)
    return 0 if are_well and all(one.running for one in computers) else 1


def fleet_table(fleet: Fleet) -> str:
    """Returns the status table: a line for the fleet, one for each robot, and one for each fault."""
    factor = fleet["real_time_factor"]
    facts = [
        f"{fleet['world']}: {fleet['phase']}",
        f"up {time.time() - fleet['started']:.0f} s",
        f"real-time factor {'–' if factor is None else format(factor, '.2f')}",
        f"base station {fleet['master']}",
        f"pid {fleet['pid']}",
    ]
    age = fleet["age"]
    old = []
    if age > STALE:
        old.append(
            f"these figures are {age:.0f} s old: pid {fleet['pid']} does not write new ones (kill -9 ends it)"
        )
    rows = [_row(robot, age) for robot in fleet["robots"]]
    return printable(
        "\n".join([", ".join(facts), *old, aligned([HEADINGS, *rows]), *fleet["faults"]])
    )


def _row(robot: Mapping[str, Any], age: float) -> tuple[str, ...]:
    """Returns a robot's row; ``age`` of its figures [s]."""
    pose, error = robot["pose"], robot["localisation_error"]
    lost = f", {robot['aborted']} lost" if robot["aborted"] else ""
    return (
        robot["robot"],
        robot["state"],
        f"{'drives' if robot['moving'] else 'stands'} {robot['speed']:.2f} m/s",
        "none"
        if robot["odom_age"] is None
        else f"{robot['odom_age'] + (age if age > STALE else 0.0):.2f} s",
        "-" if pose is None else f"({pose[0]:.2f}, {pose[1]:.2f})",
        "-" if error is None else f"{error:.2f} m",
        f"{robot['reached']}/{robot['received']}{lost}",
        robot["waypoint"] or "",
    )


def _rviz(options: argparse.Namespace) -> NoReturn:
    fleets = running_fleets()
    if not fleets and _has_containers(options.project):
        raise ContainerError(
            "the fleet runs in containers: ./pioneer up --desktop has its RViz in the browser"
        )
    master = _chosen(fleets, options.fleet)["master"]
    if not os.environ.get("DISPLAY"):
        snapshot = f"ROS_MASTER_URI={master} ./pioneer run rosrun pioneer_description rviz_snapshot -o rviz.png"
        raise ContainerError(
            f"RViz needs a display, and DISPLAY is not set; for a picture: {snapshot}"
        )
    launch = [
        "roslaunch",
        "--no-summary",
        "pioneer_description",
        "multi_pioneer_rviz.launch",
        "description:=false",
    ]
    _become(master, launch)


def _teleop(options: argparse.Namespace) -> int:
    command, fleets = ["rosrun", "pioneer_fleet", "teleop", options.robot], running_fleets()
    if not fleets and _has_containers(options.project):
        from containers.__main__ import execute_on

        options.computer, options.command = options.robot.replace("pioneer", "aadi"), command
        return execute_on(options)
    having = [fleet for fleet in fleets if options.robot in _masters(fleet)]
    if fleets and not having:
        known = sorted({robot for fleet in fleets for robot in _masters(fleet)})
        raise ContainerError(f"no robot '{options.robot}'; there are {', '.join(known)}")
    is_clear = options.fleet is None and len(having) == 1
    masters = _masters(having[0] if is_clear else _chosen(fleets, options.fleet))
    if options.robot not in masters:
        raise ContainerError(
            f"no robot '{options.robot}' in the fleet; there are {', '.join(masters)}"
        )
    return _become(masters[options.robot], command)


def _masters(fleet: Fleet) -> dict[str, str]:
    """Returns the URI of each robot's master."""
    return {robot["robot"]: robot["master"] for robot in fleet["robots"]}


def _chosen(fleets: Sequence[Fleet], pid: int | None) -> Fleet:
    """Returns the only fleet, or that of the process ``pid``.

    Raises:
        ContainerError: there is none, or several and no choice; with what runs and how to choose.
    """
    if not fleets:
        raise ContainerError("no fleet runs: ./pioneer fleet starts one")
    running = "; ".join(
        f"--fleet {fleet['pid']}: {', '.join(_masters(fleet))} in {fleet['world']}, "
        f"up {time.time() - fleet['started']:.0f} s"
        for fleet in fleets
    )
    if pid is None and len(fleets) > 1:
        raise ContainerError(f"{len(fleets)} fleets run; choose one: {running}")
    found = [fleet for fleet in fleets if pid in (None, fleet["pid"])]
    if not found:
        raise ContainerError(f"no fleet has the process {pid}; there are {running}")
    return found[0]


def _become(master: str, command: Sequence[str]) -> NoReturn:
    """Replaces this process with a command in the workspace's environment, on a master of this machine."""
    os.environ.update(ROS_MASTER_URI=master, ROS_IP="127.0.0.1")
    for name in ("ROS_HOSTNAME", "ROS_NAMESPACE"):
        os.environ.pop(name, None)
    os.execv(containers.ROOT / "pioneer", ["./pioneer", "run", *command])


def _has_containers(project: str) -> bool:
    """Returns whether a fleet of containers exists, using Docker's fastest query."""
    if shutil.which("docker") is None:
        return False
    if stack(project).file.is_file():
        return True
    question = ["docker", "ps", "-aq", "--filter", f"label=com.docker.compose.project={project}"]
    return bool(
        subprocess.run(question, capture_output=True, text=True, check=False).stdout.strip()
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
