"""A demo's report: its numbers and their table."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pioneer_demo.observer.fleet import Fleet
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.report.view import number
from pioneer_harness.accounting import Usage
from pioneer_node.core.count import counted

FORMAT = 1


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How the demo ended."""

    faults: list[
        str
    ]  #: failed criteria and processes that did not end when asked to, one line each
    milestones: Mapping[
        str, float
    ]  #: wall time since the command was entered [s], in chronological order
    seconds_to_moving: float  #: the same for the moment when the last robot started to move; nan if one never moved
    drive_wall: float  #: wall time from sending the waypoints to the end [s]
    drive_cpu: float  #: CPU time [s] of all processes in that time
    costs: Mapping[str, Usage]  #: by kind of process, including start-up


def report(fleet: Fleet, outcome: Outcome, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the content of ``report.json``; unknown values are None. SI units."""
    drive = fleet.ended - fleet.began
    return _without_nan(
        {
            "format": FORMAT,
            "success": not outcome.faults,
            "faults": outcome.faults,
            "settings": dict(settings),
            "seconds_to_moving": outcome.seconds_to_moving,
            "start_up": dict(outcome.milestones),
            "drive": {
                "simulated_seconds": drive,
                "closest_approach": fleet.closest if math.isfinite(fleet.closest) else math.nan,
                "wall_seconds": outcome.drive_wall,
                "real_time_factor": drive / outcome.drive_wall if outcome.drive_wall else math.nan,
                "cpu_seconds_per_simulated_second": outcome.drive_cpu / drive
                if drive
                else math.nan,
                "messages": fleet.traffic.messages,
                "bytes": fleet.traffic.bytes,
            },
            "robots": {robot.name: _robot(robot, fleet.began) for robot in fleet.robots},
            "processes": {
                name: {"cpu_seconds": cost.cpu, "rss_bytes": cost.rss, "count": cost.processes}
                for name, cost in outcome.costs.items()
            },
        }
    )


def reproducible(numbers: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Splits a lockstep run's ``report`` into reproducible and machine-dependent values (time, processes, ports)."""
    machine: dict[str, Any] = {
        name: numbers[name] for name in ("seconds_to_moving", "start_up", "processes")
    }
    rest = {name: value for name, value in numbers.items() if name not in machine}
    rest["settings"] = {
        name: value for name, value in numbers["settings"].items() if name != "ports"
    }
    rest["drive"] = {
        name: numbers["drive"][name] for name in ("simulated_seconds", "closest_approach")
    }
    return rest, {"ports": numbers["settings"]["ports"], "drive": numbers["drive"], **machine}


def table(numbers: Mapping[str, Any]) -> str:
    """Returns the closing table for a ``report``."""
    return "\n".join(
        [
            _robot_table(numbers["robots"]),
            "",
            _drive_line(numbers),
            "",
            _cost_table(numbers["processes"]),
        ]
    )


def _robot(robot: RobotTrack, began: float) -> dict[str, Any]:
    mean, p95, largest = robot.error_statistics()
    # Of a robot that is stuck there is no time: that of its last waypoint would be the better the earlier it failed.
    ended = max(visit.time for visit in robot.visits) if robot.finished else math.nan
    return {
        "waypoints": len(robot.visits),
        "reached": robot.reached,
        "seconds": ended - began,
        "path_length": robot.path_length,
        "localisation_error": {
            "mean": mean,
            "p95": p95,
            "max": largest,
            "samples": len(robot.errors),
        },
        "collisions": robot.collisions,
        "visits": [
            {
                "x": visit.leg.goal.x,
                "y": visit.leg.goal.y,
                "heading_degrees": math.degrees(visit.leg.goal.yaw),
                "reached": visit.reached,
                "seconds": visit.time - began,
                "true_distance": visit.distance,
                "shortest_way": visit.leg.length,
            }
            for visit in robot.visits
        ],
    }


def _robot_table(robots: Mapping[str, Any]) -> str:
    head = ("robot", "waypoints", "time", "path", "loc. error mean", "p95", "collisions")
    rows = [
        (
            name,
            f"{robot['reached']}/{robot['waypoints']}",
            f"{number(robot['seconds'], 1)} s",
            f"{number(robot['path_length'], 1)} m",
            f"{number(robot['localisation_error']['mean'], 3)} m",
            f"{number(robot['localisation_error']['p95'], 3)} m",
            str(robot["collisions"]),
        )
        for name, robot in robots.items()
    ]
    return columns(head, rows)


def _drive_line(numbers: Mapping[str, Any]) -> str:
    drive = numbers["drive"]
    return (
        f"{number(drive['simulated_seconds'], 1)} s simulated in {number(drive['wall_seconds'], 1)} s: real-time "
        f"factor {number(drive['real_time_factor'], 2)}, {number(drive['cpu_seconds_per_simulated_second'], 2)} "
        f"CPU-s a simulated second; all moving {number(numbers['seconds_to_moving'], 1)} s after the start\n"
        f"{drive['messages']} messages, {drive['bytes'] / 1e6:.1f} MB between base station and robots"
    )


def _cost_table(processes: Mapping[str, Any]) -> str:
    total = {
        "count": sum(cost["count"] for cost in processes.values()),
        "cpu_seconds": sum(cost["cpu_seconds"] for cost in processes.values()),
        "rss_bytes": sum(cost["rss_bytes"] for cost in processes.values()),
    }
    rows = [
        (
            name,
            str(cost["count"]),
            f"{cost['cpu_seconds']:.1f} s",
            f"{cost['rss_bytes'] / 1e6:.0f} MB",
        )
        for name, cost in [*processes.items(), ("all", total)]
    ]
    return columns(("processes", "seen", "CPU", "peak RSS"), rows)


def columns(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Returns a table as text: first column left-aligned, the others right-aligned."""
    widths = [max(len(row[index]) for row in [head, *rows]) for index in range(len(head))]
    return "\n".join(
        "  ".join(
            f"{cell:<{width}}" if not index else f"{cell:>{width}}"
            for index, (cell, width) in cells
        ).rstrip()
        for cells in (enumerate(zip(row, widths, strict=True)) for row in [head, *rows])
    )


def verdict_line(numbers: Mapping[str, Any]) -> str:
    """Returns the final sentence of the demo."""
    if not numbers["success"]:
        return "Failed: " + "; ".join(numbers["faults"])
    robots = numbers["robots"].values()
    sent, reached, collisions = (
        sum(robot[key] for robot in robots) for key in ("waypoints", "reached", "collisions")
    )
    arrived = (
        counted(sent, "waypoint")
        if reached == sent
        else f"{reached} of {counted(sent, 'waypoint')}"
    )
    contacts = counted(collisions, "collision") if collisions else "no collision"
    return f"Success: {counted(len(robots), 'robot')}, {arrived} reached, {contacts}"


def _without_nan(value: Any) -> Any:
    """Returns ``value`` with every nan replaced by None, because JSON has no nan."""
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_nan(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value
