"""A study: variants of a scenario, each run with the same seeds, and one row of metrics per run."""

import dataclasses
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pioneer_node.core.document import DocumentError

METRICS = {
    "spl": "SPL (success weighted by path length)",
    "missed": "waypoints missed, all robots",
    "seconds": "time until all are done [s]",
    "path_length": "path length, mean of the robots [m]",
    "localisation_error": "localisation error, mean of the robots [m]",
    "collisions": "collisions, all robots",
    "closest_approach": "closest approach of two robots [m]",
    "cpu_seconds": "CPU time a simulated second [s]",
    "messages": "messages between base station and robots",
    "bytes": "bytes of these messages",
}
"""Metrics compared in addition to success, with their descriptions."""
CENSORED = ("seconds", "path_length")
"""Metrics that a run without an end has not: they count as worse than those of every run that has ended."""
MOST_SEED = 2**31 - 1
_SPREAD = 2.0
"""Number of standard deviations that a spread shows to each side."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Study:
    """Content of a study's file."""

    scenario: str  #: name of a shipped scenario, or a file
    about: str = ""  #: the question it answers
    #: changes to the scenario by variant name; the first variant is the baseline
    variants: dict[str, dict[str, Any]] = dataclasses.field(
        default_factory=lambda: {"as it is": {}}
    )
    runs: int = 10  #: runs per variant, with seeds from ``first_seed`` on
    first_seed: int = 1  #: seed of each variant's first run
    #: command line that replaces ``run-scenario``; it gets ``FILE --seed S --report DIR`` and writes DIR/report.json
    #: in the demo's format
    program: str = ""

    def __post_init__(self) -> None:
        """Validates the fields."""
        if not 1 <= self.runs <= 100_000:
            raise DocumentError(f"runs must be 1 to 100000, not {self.runs}", "runs")
        if not 0 <= self.first_seed <= MOST_SEED - self.runs:
            raise DocumentError(
                f"first_seed must be 0 to {MOST_SEED - self.runs}, not {self.first_seed}",
                "first_seed",
            )
        if not self.variants:
            raise DocumentError("there must be 1 variant or more", "variants")
        for name in self.variants:
            if not name.replace("-", "").replace("_", "").replace(" ", "").isalnum():
                raise DocumentError(
                    f"a variant's name has letters, digits, blanks, - and _, not {name!r}",
                    "variants",
                )

    def all_runs(self) -> list["Run"]:
        """Returns all runs, seed by seed, so that an unfinished study can still compare variants."""
        seeds = range(self.first_seed, self.first_seed + self.runs)
        return [Run(variant, seed) for seed in seeds for variant in self.variants]


@dataclasses.dataclass(frozen=True, order=True)
class Run:
    """One run of a study."""

    variant: str
    seed: int

    @property
    def name(self) -> str:
        """Name of its file, without suffix."""
        return f"{self.variant}-{self.seed}"


def merged(content: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the content with a variant's changes applied: mappings are merged, other values replaced."""
    inner = {
        name: merged(content[name], value)
        for name, value in change.items()
        if isinstance(value, Mapping) and isinstance(content.get(name), Mapping)
    }
    return {**content, **change, **inner}


def row_of(run: Run, report: Mapping[str, Any], wall: float) -> dict[str, Any]:
    """Returns a run's row of metrics from the demo's report; unknown values are None.

    What a run without an end has not is None too: the time until all robots have reached all their waypoints, the
    length of their paths, and the messages until then.

    Args:
        run: the run.
        report: the content of ``report.json``.
        wall: its wall time [s].
    """
    robots = list(report.get("robots", {}).values())
    drive = report.get("drive", {})
    finished = bool(robots) and all(_has_finished(robot) for robot in robots)
    errors = _known((robot.get("localisation_error") or {}).get("mean") for robot in robots)
    collisions = _known(robot.get("collisions") for robot in robots)
    missed = [robot["waypoints"] - robot["reached"] for robot in robots if "reached" in robot]
    row: dict[str, Any] = {
        **dataclasses.asdict(run),
        "success": bool(report.get("success")),
        "finished": finished,
        "spl": _spl(robots),
        "missed": sum(missed) if missed else None,
        "seconds": None,
        "path_length": None,
        "localisation_error": statistics.fmean(errors) if errors else None,
        "collisions": sum(collisions) if collisions else None,
        "closest_approach": drive.get("closest_approach"),
        "cpu_seconds": drive.get("cpu_seconds_per_simulated_second"),
        "messages": None,
        "bytes": None,
        "wall_seconds": round(wall, 1),
        "faults": "; ".join(report.get("faults", ())),
    }
    if finished:
        paths = _known(robot.get("path_length") for robot in robots)
        row["seconds"] = max(robot["seconds"] for robot in robots)
        row["path_length"] = statistics.fmean(paths) if paths else None
        row["messages"] = drive.get("messages")
        row["bytes"] = drive.get("bytes")
    return row


def _has_finished(robot: Mapping[str, Any]) -> bool:
    """Returns whether a robot has reached all its waypoints; one without any has if it has an end."""
    return robot.get("seconds") is not None and robot.get("reached") == robot.get("waypoints")


def _spl(robots: Iterable[Mapping[str, Any]]) -> float | None:
    """Returns success weighted by path length (Anderson et al. 2018, arXiv:1807.06757), mean of the robots.

    A robot has 0 if it missed a waypoint, else the ratio of its shortest way to the longer of that and its path. None
    if a robot's way or path is unknown.
    """
    shares = []
    for robot in robots:
        ways = [visit.get("shortest_way") for visit in robot.get("visits", ())]
        path = robot.get("path_length")
        if not ways or None in ways or path is None:
            return None
        shortest = sum(ways)
        longest = max(path, shortest)
        # A robot that stands at its goal has no way to go.
        share = shortest / longest if longest > 0.0 else 1.0
        shares.append(share if _has_finished(robot) else 0.0)
    return statistics.fmean(shares) if shares else None


def time_left(walls: Sequence[float], left: int, workers: int) -> str:
    """Returns how long the runs that are left take, from those that have ended, with its spread; in minutes.

    Args:
        walls: wall times of the runs that have ended [s].
        left: number of runs to do.
        workers: number of runs at a time.
    """
    if not walls or not workers:
        return "time left unknown"
    at_once = min(workers, left) or 1
    mean = statistics.fmean(walls) * left / at_once
    if len(walls) < 2:
        return f"about {mean / 60:.0f} min left"
    # Of the sum of the runs that are left, and of the mean that it is estimated from.
    spread = statistics.stdev(walls) * math.sqrt(left + left * left / len(walls)) / at_once
    low = max(0.0, mean - _SPREAD * spread)
    high = mean + _SPREAD * spread
    return f"about {mean / 60:.0f} min left ({low / 60:.0f} … {high / 60:.0f})"


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
