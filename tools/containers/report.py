"""The state of each computer, by pioneer_fleet's ``report`` in every container in parallel; and its text for people."""

import json
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from containers.engine import Computer

_WORKSPACE = "/opt/pioneer/catkin_ws"
REPORT = (
    f"{_WORKSPACE}/src/pioneer_launch/scripts/forked",
    f"{_WORKSPACE}/devel/lib/pioneer_fleet/report",
)
"""The command without the arguments of ``report``. As a fork of the computer's process it need not import rospy."""
HEADINGS = (
    "COMPUTER",
    "CONTAINER",
    "GATEWAY",
    "RULES",
    "ROBOT",
    "ODOM",
    "SCAN",
    "LOCALISED",
    "WAYPOINTS",
    "MISSING / LAST WORD",
)


def follow(
    asked: Sequence[tuple[Computer, Sequence[str]]],
    heard: Callable[[Computer, dict[str, Any]], None],
) -> dict[str, bool]:
    """Runs the report on computers in parallel, each with its arguments, until all end; ``heard`` gets each line.

    Returns:
        By computer, whether it reached the requested state.
    """
    lock, results = threading.Lock(), dict[str, bool]()

    def run(computer: Computer, arguments: Sequence[str]) -> None:
        command = [
            *computer.docker,
            "exec",
            computer.container,
            *REPORT,
            "--robot",
            computer.robot,
            *arguments,
        ]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                with lock:
                    heard(computer, json.loads(line))
            problem = process.stderr.read().strip()
        if process.returncode > 1 or (process.returncode and problem):
            with lock:
                heard(
                    computer,
                    {
                        "lacks": (problem.splitlines() or ["the container has ended"])[-1],
                        "stage": "starting",
                    },
                )
        results[computer.name] = process.returncode == 0

    threads = [threading.Thread(target=run, args=one) for one in asked]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def progress_line(name: str, report: Mapping[str, Any]) -> str:
    """Returns one line on the progress of a computer's start-up."""
    return f"{name:16} {report['stage']:9} {_words(report)}".rstrip()


def status_table(computers: Sequence[Computer], reports: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns a table with one row per computer."""
    rows = [HEADINGS, *(_row(computer, reports.get(computer.name, {})) for computer in computers)]
    if any(computer.node for computer in computers):
        nodes = ["NODE", *(computer.node or "-" for computer in computers)]
        rows = [(row[0], node, *row[1:]) for row, node in zip(rows, nodes, strict=True)]
    return aligned(rows)


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Returns rows as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def _row(computer: Computer, report: Mapping[str, Any]) -> tuple[str, ...]:
    state = computer.health if computer.running and computer.health else computer.state
    words = _words(report) or computer.problem
    if not report.get("gateway"):
        return (computer.name, state, *["-"] * 7, words)
    rules = f"{report['active']}/{report['rules']}"
    gateway = "on the hub" if report["hub"] else "no hub"
    if not computer.robot:
        factor = report["real_time_factor"]
        world = f"{len(report['models'])} in {computer.environment.get('WORLD', '')}"
        return (
            computer.name,
            state,
            gateway,
            rules,
            world,
            "-",
            "-",
            "-",
            "-",
            words or f"real-time factor {factor}",
        )
    moves = f"{'drives' if report['moving'] else 'stands'} {report['speed']:.2f} m/s"
    counts = f"{report['reached']}/{report['received']}" + (
        f", {report['aborted']} lost" if report["aborted"] else ""
    )
    place = "-" if report["deviation"] is None else f"±{report['deviation']:.2f} m"
    return (
        computer.name, state, gateway, rules, moves,
        _age(report["odom_age"]), _age(report["scan_age"]), place, counts, words,
    )  # fmt: skip


def _words(report: Mapping[str, Any]) -> str:
    """Returns what a computer lacks, else why its robot does not get on, else what its waypoint client said last."""
    return str(report.get("lacks") or report.get("trouble") or report.get("waypoint") or "")


def _age(seconds: float | None) -> str:
    return "none" if seconds is None else f"{seconds:.2f} s"
