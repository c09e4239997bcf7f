"""``pioneer_bench nav --hard``: hard navigation courses, driven without ROS, beside the C++ stack's figures."""

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rospkg
import yaml

from pioneer_bench.core import blocked, course
from pioneer_bench.core.course import Course
from pioneer_bench.core.ride import Ride, ride, with_changes
from pioneer_bench.core.row import Row

_DWA = {"base_local_planner": "dwa_local_planner/DWAPlannerROS"}
_MOST = 1000


@dataclass(frozen=True)
class Trial:
    """A course, the greatest number of seeds to drive it with, and the changes to the shipped parameters.

    ``jitter`` is that of ``Rider``: how irregular the control loop is.
    """

    make: Callable[[int], Course]
    seeds: int = 1
    changes: Callable[[int], Mapping[str, Any]] = lambda _: {}
    jitter: float = 0.0


_JITTER = 1.5
"""Command periods of up to 2.5 times the nominal one, as on a machine with little time."""
_BLOCKED = {
    "hidden wall": blocked.barrier,
    "hidden wall with a way round": blocked.detour,
    "hidden U": blocked.trap,
    "door that shuts": blocked.shut_door,
    "box on the goal": blocked.occupied,
    "dense hidden clutter": blocked.thicket,
}
_DRIVEN_TWICE = {
    **{name: Trial(make, _MOST) for name, make in _BLOCKED.items()},
    **{
        f"{name}, irregular loop": Trial(make, _MOST, jitter=_JITTER)
        for name, make in _BLOCKED.items()
    },
}

TRIALS = {
    "clutter": Trial(course.clutter, _MOST),
    "clutter, meeting_distance 0": Trial(course.clutter, 5, lambda _: {"meeting_distance": 0.0}),
    "doors": Trial(lambda _: course.doors()),
    "doors, DWAPlannerROS": Trial(lambda _: course.doors(), 1, lambda _: _DWA),
    "slalom": Trial(lambda _: course.slalom()),
    "slalom, clearance_scale 0": Trial(
        lambda _: course.slalom(), 1, lambda _: {"TrajectoryPlannerROS/clearance_scale": 0.0}
    ),
    "slalom, DWAPlannerROS": Trial(lambda _: course.slalom(), 1, lambda _: _DWA),
    "corridor": Trial(lambda _: course.corridor()),
    "maze": Trial(course.maze, _MOST),
    "maze, DWAPlannerROS": Trial(course.maze, _MOST, lambda _: _DWA),
    "maze, random parameters": Trial(course.maze, _MOST, lambda seed: random_changes(seed)),
    "unreachable goal": Trial(lambda _: course.unreachable()),
    "box below the laser": Trial(lambda _: course.doorstep()),
    **_DRIVEN_TWICE,
}
CLEARANCE_GOAL, SPEED_GOAL, PATIENCE_GOAL, TIME_GOAL = 0.25, 0.38, 25.6, 118.0
"""Figures of the C++ stack, measured side by side: gap to walls [m], speed in clutter [m/s], time until it gives up
[s], time for eight goals among thirty cylinders [s]."""


def shipped_parameters() -> dict[str, Any]:
    """Returns the parameters of ``pioneer_2dnav`` as move_base's launch file loads them."""
    folder = Path(rospkg.RosPack().get_path("pioneer_2dnav")) / "config"

    def load(name: str) -> dict[str, Any]:
        return dict(yaml.safe_load((folder / f"{name}_params.yaml").read_text()))

    parameters = {**load("base_local_planner"), **load("dwa_local_planner")}
    for name in ("global_costmap", "local_costmap"):
        parameters[name] = {**load("costmap_common"), **load(name)[name]}
    return parameters


def random_changes(seed: int) -> dict[str, Any]:
    """Returns random parameter changes, within the range of robot configurations in use."""
    generator = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return round(float(generator.uniform(low, high)), 3)

    def one_of(*values: float) -> float:
        return float(generator.choice(values))

    planner = {
        "max_vel_x": between(0.3, 1.0), "min_vel_x": one_of(0.0, 0.05, 0.1), "acc_lim_x": between(0.5, 3.0),
        "acc_lim_theta": between(1.0, 3.2), "max_vel_theta": between(0.6, 1.5),
        "min_in_place_vel_theta": between(0.2, 0.5),
        "path_distance_bias": between(0.4, 1.2), "goal_distance_bias": between(0.4, 1.2),
        "occdist_scale": one_of(0.01, 0.02, 0.05),
        "sim_time": between(1.0, 2.5), "vx_samples": int(generator.integers(3, 21)),
        "vtheta_samples": int(generator.integers(10, 31)), "heading_lookahead": between(0.2, 0.6),
        "meter_scoring": bool(generator.integers(2)), "dwa": bool(generator.integers(2)),
    }  # fmt: skip
    planner["min_vel_theta"] = -planner["max_vel_theta"]
    costmap = {"inflation_radius": between(0.4, 1.0), "cost_scaling_factor": between(2.0, 10.0)}
    changes: dict[str, Any] = {
        f"TrajectoryPlannerROS/{name}": value for name, value in planner.items()
    }
    for name in ("global_costmap", "local_costmap"):
        changes.update({f"{name}/{each}": value for each, value in costmap.items()})
    return changes | {
        "controller_frequency": one_of(5.0, 10.0, 20.0),
        "planner_frequency": one_of(0.0, 0.5, 1.0),
    }


def _driven(asked: tuple[str, int, Mapping[str, Any]]) -> tuple[str, Ride]:
    name, seed, parameters = asked
    trial = TRIALS[name]
    return name, ride(
        trial.make(seed), with_changes(parameters, trial.changes(seed)), seed, trial.jitter
    )


def hard_rows(seeds: int, processes: int) -> list[Row]:
    """Drives all courses, the random ones with seeds 1 to ``seeds``; returns their rows."""
    parameters = shipped_parameters()
    asked = [
        (name, seed, parameters)
        for name, trial in TRIALS.items()
        for seed in range(1, min(seeds, trial.seeds) + 1)
    ]
    rides: dict[str, list[Ride]] = {name: [] for name in TRIALS}
    with ProcessPoolExecutor(min(processes, os.cpu_count() or 1)) as pool:
        for (_, seed, _), (name, each) in zip(asked, pool.map(_driven, asked), strict=True):
            rides[name].append(each)
            print(f"{name}, seed {seed}: {each.summary()}", flush=True)
    return [row for name, driven in rides.items() for row in _rows(name, driven)]


def _rows(name: str, rides: list[Ride]) -> Iterator[Row]:
    def samples(field: str) -> tuple[float, ...]:
        return tuple(float(getattr(each, field)) for each in rides)

    given_up = tuple(seconds for each in rides for seconds in each.given_up)
    if given_up:
        goal = PATIENCE_GOAL if name == "unreachable goal" else None
        yield Row(f"{name}: given up after", "s", given_up, goal, remark="C++" if goal else "")
    if not sum(samples("reachable")):
        return
    yield Row(
        f"{name}: goals reached", "", (sum(samples("reached")),), sum(samples("reachable")), True
    )
    yield Row(f"{name}: contacts", "", samples("contacts"), 0.0, every=True)
    yield Row(f"{name}: stuck for good", "", samples("stuck"), 0.0, every=True)
    clear = CLEARANCE_GOAL if name.startswith("slalom") and "scale" not in name else None
    yield Row(
        f"{name}: least gap to what stands",
        "m",
        samples("clearance"),
        clear,
        True,
        "C++" if clear else "",
    )
    speeds = tuple(each.way / each.seconds for each in rides)
    clutter = name == "clutter"
    yield Row(
        f"{name}: speed",
        "m/s",
        speeds,
        SPEED_GOAL if clutter else None,
        True,
        "C++" if clutter else "",
    )
    yield Row(f"{name}: way", "m", samples("way"))
    yield Row(
        f"{name}: time",
        "s",
        samples("seconds"),
        TIME_GOAL if clutter else None,
        remark="C++" if clutter else "",
    )
    yield Row(f"{name}: recoveries", "", samples("recoveries"))
    yield Row(f"{name}: turning", "rad", samples("turned"))
    yield Row(f"{name}: time in reverse", "s", samples("reverse"))
    yield Row(
        f"{name}: share of time below 0.2 m/s",
        "",
        tuple(each.slow / each.seconds for each in rides),
    )
