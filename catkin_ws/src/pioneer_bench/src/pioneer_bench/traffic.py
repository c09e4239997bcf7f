"""``pioneer_bench traffic``: right of way for fleets in simulated narrow and shipped worlds, without ROS."""

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import rospkg

from nav_bundle.maps.map_file import read_map
from pioneer_bench.core.row import Row
from pioneer_bench.core.traffic import NARROW, narrow_space, random_tours, seconds_alone
from pioneer_bench.report import finish
from pioneer_traffic.geometry import Point
from pioneer_traffic.roadmap import FreeSpace, Roadmap, roadmap_from_space
from pioneer_traffic.simulation import Trial

SHIPPED = ("closed_maze", "utm_0", "small_world", "willow_office", "blank")
SWAP = "swap"
_TRIALS = "trials.jsonl"
_LIMIT = 1800.0
"""Simulated seconds after which a trial counts as stuck."""
_WAIT = 10.0
"""Time that one of two robots may wait in the bay, in addition to 1.5 times its time alone [s]."""


@dataclass(frozen=True)
class Result:
    """Results of one trial."""

    world: str
    robots: int
    seed: int
    waypoints: int
    reached: int
    asked: int
    contacts: int
    gap: float
    seconds: float
    alone: float
    slowest_alone: float
    mean: float

    @property
    def key(self) -> tuple[str, int, int, int]:
        """The trial's key: world, robots, seed, waypoints per robot."""
        return self.world, self.robots, self.seed, self.waypoints


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    worlds = [*SHIPPED, *NARROW]
    parser.add_argument("--worlds", nargs="+", choices=worlds, default=worlds, help="default: all")
    parser.add_argument(
        "--robots", type=int, nargs="+", metavar="N", default=[4, 8, 15], help="default: 4 8 15"
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=3,
        metavar="K",
        help="trials of each size (default %(default)s)",
    )
    parser.add_argument(
        "--waypoints", type=int, default=4, metavar="K", help="of each robot (default %(default)s)"
    )
    parser.add_argument(
        "--parallel",
        type=int,
        default=1,
        metavar="N",
        help="trials at a time (default %(default)s)",
    )
    parser.add_argument("--resume", action="store_true", help=f"resume the trials in DIR/{_TRIALS}")


def run(options: argparse.Namespace) -> int:
    """Drives all trials; returns 0 if every goal is met, 1 if one is missed."""
    options.output.mkdir(parents=True, exist_ok=True)
    results = _results(options)
    remark = "A sample is a trial. Seconds are simulated ones."
    status = finish(options, "traffic", "Right of way", _rows(results), remark)
    _draw(results, options.output / "traffic.png")
    _draw_densest(results, options.output / "traffic_densest.png")
    print(f"and traffic.png, traffic_densest.png and {_TRIALS}")
    return status


def _results(options: argparse.Namespace) -> list[Result]:
    """Returns the results of all requested trials; appends each to a file as soon as it is available."""
    asked = [
        (world, robots, seed, options.waypoints)
        for seed in range(options.seeds)
        for world in options.worlds
        for robots in ([2] if world == SWAP else options.robots)
    ]
    path = options.output / _TRIALS
    lines = path.read_text().splitlines() if options.resume and path.exists() else []
    known = {one.key: one for one in (Result(**json.loads(line)) for line in lines)}
    missing = [key for key in asked if key not in known]
    with (
        ProcessPoolExecutor(options.parallel) as pool,
        path.open("a" if options.resume else "w") as file,
    ):
        for result in pool.map(_trial, *zip(*missing, strict=True)) if missing else ():
            known[result.key] = result
            print(json.dumps(asdict(result)), file=file, flush=True)
            print(_line(result), flush=True)
    return [known[key] for key in asked]


@cache
def _world(name: str) -> tuple[FreeSpace, Roadmap]:
    if name in NARROW:
        space = narrow_space(name)
    else:
        grid = read_map(Path(rospkg.RosPack().get_path("pioneer_gazebo")) / "map" / f"{name}.yaml")
        space = FreeSpace.of_grid(grid)
    return space, roadmap_from_space(space)


def _tours(
    world: str, robots: int, seed: int, waypoints: int
) -> tuple[list[Point], list[list[Point]]]:
    if world == SWAP:
        ends = [(0.45, 0.45), (29.45, 0.45)]
        return ends, [[ends[1]], [ends[0]]]
    return random_tours(*_world(world), robots, waypoints, seed)


def _trial(world: str, robots: int, seed: int, waypoints: int) -> Result:
    space, roadmap = _world(world)
    starts, tours = _tours(world, robots, seed, waypoints)
    alone = [
        seconds_alone(space, roadmap, start, tour)
        for start, tour in zip(starts, tours, strict=True)
    ]
    outcome = Trial(roadmap, space, starts, tours, seed=seed).run(_LIMIT)
    done = [min(seconds, _LIMIT) for seconds in outcome.finished]
    return Result(
        world,
        robots,
        seed,
        waypoints,
        outcome.reached,
        outcome.asked,
        outcome.contacts + outcome.shared,
        round(min(outcome.gap, 9.0), 3),
        round(max(done), 1),
        round(sum(alone), 1),
        round(max(alone), 1),
        round(sum(done) / len(done), 1),
    )


def _line(one: Result) -> str:
    return (
        f"{one.world}, {one.robots} robots, seed {one.seed}: {one.reached} of {one.asked} waypoints, "
        f"{one.contacts} contacts, {one.seconds:.0f} s; alone the slowest {one.slowest_alone:.0f} s, "
        f"one after another {one.alone:.0f} s"
    )


def _rows(results: Sequence[Result]) -> list[Row]:
    rows = list[Row]()
    for world, robots in dict.fromkeys((one.world, one.robots) for one in results):
        own = [one for one in results if (one.world, one.robots) == (world, robots)]
        name = f"{world}, {robots} robots"
        missed = tuple(float(one.asked - one.reached) for one in own)
        rows.append(Row(f"{name}: waypoints missed", "", missed, 0.0, every=True))
        rows.append(
            Row(f"{name}: contacts", "", tuple(float(one.contacts) for one in own), 0.0, every=True)
        )
        seconds = tuple(one.seconds for one in own)
        goal = 1.5 * own[0].slowest_alone + _WAIT if world == SWAP else None
        rows.append(Row(f"{name}: time", "s", seconds, goal, every=True))
        shares = tuple(one.seconds / one.alone for one in own)
        rows.append(Row(f"{name}: time by that of one after another", "", shares))
    return rows


def _draw(results: Sequence[Result], path: Path) -> None:
    """Plots completion time against the sum of the robots' times alone."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.5), layout="constrained")
    axes = figure.subplots()
    sizes = sorted({one.robots for one in results})
    for number, world in enumerate(dict.fromkeys(one.world for one in results)):
        for size in sizes:
            own = [one for one in results if (one.world, one.robots) == (world, size)]
            label = (
                world
                if own and size == max(one.robots for one in results if one.world == world)
                else None
            )
            axes.scatter(
                [one.alone for one in own],
                [one.seconds for one in own],
                s=6.0 + 3.0 * size,
                alpha=0.6,
                color=f"C{number}",
                edgecolor="none",
                label=label,
            )
    end = max(one.alone for one in results)
    axes.plot([0.0, end], [0.0, end], "k--", linewidth=1.0, label="one after another")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="sum of the robots' times alone [s]",
        ylabel="until the last robot is done [s]",
        title=f"Right of way: random tours of {', '.join(map(str, sizes))} robots (larger dots: more)",
    )
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def _draw_densest(results: Sequence[Result], path: Path) -> None:
    """Repeats the trial with the most robots per place of its roadmap, and draws the robots' tracks."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    one = max(results, key=lambda one: (one.robots / len(_world(one.world)[1].places), -one.seed))
    (space, roadmap), (starts, tours) = _world(one.world), _tours(*one.key)
    trial = Trial(roadmap, space, starts, tours, seed=one.seed)
    tracks = [[body.position for body in trial.bodies]]
    while trial.time < one.seconds:
        trial.step()
        tracks.append([body.position for body in trial.bodies])
    rows, cols = space.room.shape
    (left, low), size = space.corner, space.resolution
    figure = Figure(figsize=(12.0, 12.0 * rows / cols + 0.8), layout="constrained")
    axes = figure.subplots()
    extent = (left, left + cols * size, low, low + rows * size)
    axes.imshow(space.room > 0.0, cmap="gray", vmin=-1.0, vmax=1.0, origin="lower", extent=extent)
    for robot, track in enumerate(zip(*tracks, strict=True)):
        colour = colormaps["tab20"](robot % 20)
        axes.plot(*zip(*track, strict=True), color=colour, linewidth=0.8, alpha=0.8)
        axes.plot(*starts[robot], marker="o", color=colour, markersize=5)
        axes.plot(
            *zip(*tours[robot], strict=True), marker="x", linestyle="", color=colour, markersize=6
        )
    axes.set(
        title=f"{one.world}, {one.robots} robots, seed {one.seed}: {one.reached} of {one.asked} waypoints in "
        f"{one.seconds:.0f} s; dots are starts, crosses waypoints",
        xlabel="x [m]",
        ylabel="y [m]",
    )
    figure.savefig(path, dpi=110)
