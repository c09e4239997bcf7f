"""CPU time per call of navigation without ROS: plans, costmaps, the local planners' cycle and amcl's update."""

import gc
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Scan
from nav_bundle.base.velocity import Velocity
from nav_bundle.control.dwa_config import DwaConfig
from nav_bundle.control.dwa_planner import DwaPlanner
from nav_bundle.control.local_planner import LocalPlanner, Situation
from nav_bundle.control.trajectory_config import TrajectoryConfig
from nav_bundle.control.trajectory_planner import TrajectoryPlanner
from nav_bundle.costmap.config import (
    CostmapConfig,
    InflationConfig,
    ObstacleConfig,
    SourceConfig,
    StaticConfig,
)
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.localisation import Localisation
from nav_bundle.maps.grid import OCCUPIED, Grid
from nav_bundle.planning.global_planner import GlobalPlanner, GlobalPlannerConfig
from nav_bundle.planning.navfn import NavfnConfig, NavfnPlanner
from nav_bundle.planning.planner import Path, path_between
from pioneer_bench.core.row import Row, table

RESOLUTION = 0.05
"""Side of a cell [m]."""
ROOM = 100
"""Side of a room [cells]."""
_DOOR = 30
_FOOTPRINT = ((0.20, 0.20), (0.20, -0.20), (-0.30, -0.20), (-0.30, 0.20))
_LASER = SourceConfig(
    "base_scan",
    marking=True,
    clearing=True,
    obstacle_range=2.0,
    raytrace_range=3.0,
    min_obstacle_height=-1.0,
)
_WHOLE = CostmapConfig(
    footprint=_FOOTPRINT,
    layers=(
        StaticConfig(),
        ObstacleConfig(sources=(_LASER,)),
        InflationConfig(inflation_radius=1.5, cost_scaling_factor=5.0),
    ),
)
_WINDOW = CostmapConfig(
    footprint=_FOOTPRINT,
    rolling_window=True,
    width=3.0,
    height=3.0,
    layers=(
        ObstacleConfig(sources=(_LASER,)),
        InflationConfig(inflation_radius=2.0, cost_scaling_factor=5.0),
    ),
)
_NEAR_LENGTH = 0.15  # greatest relative deviation from the peer's path length
_BEAMS = 180


def kernel_rows(repetitions: int = 5) -> list[Row]:
    """Returns the rows of both map sizes and of the planner cycles; takes about half a minute."""
    small = _costmap(_grid(400))
    rows = [
        *_plan_rows(small, {12.0: (2.9, 1.6, 1.0), 27.0: (8.9, 1.9, None)}, repetitions, "C++"),
        *_cycle_rows(small, repetitions),
        *_amcl_rows(repetitions),
        *_whole_map_rows(),
    ]
    large = _costmap(_grid(4000))
    return [
        *rows,
        *_plan_rows(
            large,
            {30.0: (234.0, 172.0, None), 150.0: (889.0, 229.0, None)},
            repetitions,
            "C++'s least",
        ),
    ]


def room_cells(side: int, seed: int = 1) -> NDArray[np.int8]:
    """Returns occupancy, int8 (side, side), of rooms of 5 m; each wall between two rooms has a door of 1.5 m."""
    generator = np.random.default_rng(seed)
    cells = np.zeros((side, side), np.int8)
    cells[:: side - 1, :] = cells[:, :: side - 1] = OCCUPIED
    walls = range(ROOM, side - ROOM // 2, ROOM)
    for wall in walls:
        cells[wall, :] = cells[:, wall] = OCCUPIED
    for wall in walls:
        for room in range(0, side, ROOM):
            across, along = room + generator.integers(15, ROOM - _DOOR - 15, 2)
            cells[wall, across : across + _DOOR] = 0
            cells[along : along + _DOOR, wall] = 0
    return cells


def _grid(side: int) -> Grid:
    return Grid(RESOLUTION, Pose(), room_cells(side))


def _costmap(grid: Grid) -> Costmap:
    costmap = Costmap(_WHOLE)
    costmap.set_map(grid)
    costmap.update(Pose(2.5, 2.5), ())
    return costmap


def _cpu_ms(work: Callable[[], object], repetitions: int) -> float:
    """Returns the least CPU time of one call [ms], including freeing its result, as in a node."""
    gc.collect()
    best = math.inf
    for _ in range(repetitions):
        begun = time.process_time()
        work()
        best = min(best, time.process_time() - begun)
    return 1e3 * best


def _length(path: Path) -> float:
    return float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())


def _ways(costmap: Costmap, length: float) -> Iterator[tuple[Pose, Pose]]:
    """Yields five pairs of random poses joined by a path of about ``length`` [m]."""
    generator = np.random.default_rng(int(length))
    planner = NavfnPlanner(NavfnConfig())
    free = np.argwhere(costmap.cells < 100)
    found = 0
    while found < 5:
        cells = free[generator.integers(len(free), size=2)]
        start, goal = (Pose(*xy) for xy in ((cells[:, ::-1] + 0.5) * RESOLUTION).tolist())
        if not length / 1.6 < start.distance(goal) < length:
            continue
        if (
            abs(_length(path_between(planner, costmap, start, goal)) - length)
            <= _NEAR_LENGTH * length
        ):
            found += 1
            yield start, goal


def _plan_rows(
    costmap: Costmap, goals: dict[float, tuple[float | None, ...]], repetitions: int, peer: str
) -> Iterator[Row]:
    side = costmap.geometry.rows
    planners = {
        "NavfnROS": NavfnPlanner(NavfnConfig()),
        "A*": GlobalPlanner(GlobalPlannerConfig(use_dijkstra=False)),
        "A*, use_grid_path": GlobalPlanner(
            GlobalPlannerConfig(use_dijkstra=False, use_grid_path=True)
        ),
    }
    for length, of_length in goals.items():
        ways = list(_ways(costmap, length))
        for (name, planner), goal in zip(planners.items(), of_length, strict=True):
            samples = [
                _cpu_ms(lambda p=planner, w=way: path_between(p, costmap, *w), repetitions)
                for way in ways
            ]
            yield Row(
                f"plan {side}², {length:g} m, {name}", "CPU ms", tuple(samples), goal, remark=peer
            )


def _whole_map_rows() -> Iterator[Row]:
    grid = _grid(4000)
    spent = _cpu_ms(lambda: _costmap(grid), 2)
    yield Row(
        "costmap 4000², made and first update", "CPU ms", (spent,), 500.0, remark="C++'s least"
    )


def _scan_at(pose: Pose) -> Observation:
    """Returns the scan of a laser at ``pose``: a wavy wall 2 m around it."""
    bearings = np.linspace(-math.pi, math.pi, _BEAMS, endpoint=False)
    ranges = 1.9 + 0.2 * np.sin(7.0 * bearings)
    points = np.stack(
        [pose.x + ranges * np.cos(bearings), pose.y + ranges * np.sin(bearings)], axis=1
    )
    return Observation(_LASER, pose.x, pose.y, np.ascontiguousarray(points))


def _cycle_rows(whole: Costmap, repetitions: int) -> Iterator[Row]:
    seen = [
        (pose, (_scan_at(pose),))
        for pose in (Pose(2.5 + 0.02 * step, 2.5, 0.3) for step in range(40))
    ]
    window = Costmap(_WINDOW)

    for name, costmap, goal in (
        ("local costmap 3 m", window, 0.50),
        ("global costmap 400²", whole, 3.4),
    ):
        each = _cpu_ms(lambda c=costmap: [c.update(*one) for one in seen], repetitions) / len(seen)
        yield Row(f"{name}, update by a scan of {_BEAMS}", "CPU ms", (each,), goal, remark="C++")
    plan = np.zeros((60, 3))
    plan[:, 0] = 2.5 + 0.05 * np.arange(60)
    plan[:, 1] = 2.5 + 0.3 * np.sin(plan[:, 0])
    trajectory = TrajectoryConfig(
        max_vel_x=1.0, meter_scoring=True, path_distance_bias=0.8, goal_distance_bias=1.0
    )
    dwa = DwaConfig(
        max_vel_trans=1.0, max_vel_x=1.0, max_vel_y=0.0, min_vel_y=0.0, vx_samples=8,
        path_distance_bias=32.0, goal_distance_bias=24.0,
    )  # fmt: skip
    planners: dict[str, LocalPlanner] = {
        "TrajectoryPlannerROS": TrajectoryPlanner(trajectory, RESOLUTION),
        "DWAPlannerROS": DwaPlanner(dwa, RESOLUTION),
    }
    window.update(Pose(2.5, 2.5), ())
    situation = Situation(window, Pose(2.5, 2.5, 0.3), Velocity(0.5, 0.0, 0.1), Pose())
    for name, planner in planners.items():
        planner.set_plan(plan)
        each = _cpu_ms(lambda p=planner: [p.decide(situation) for _ in range(20)], repetitions) / 20
        most = 7.4 if name == "TrajectoryPlannerROS" else None
        yield Row(f"{name}, one cycle", "CPU ms", (each,), most, remark="C++" if most else "")


def _amcl_rows(repetitions: int) -> Iterator[Row]:
    grid = _grid(400)
    bearings = np.linspace(-math.pi, math.pi, _BEAMS, endpoint=False)
    ranges = (2.0 + 0.3 * np.cos(4.0 * bearings)).astype(np.float32)
    scan = Scan(ranges, -math.pi, math.tau / _BEAMS, 0.1, 30.0, Pose())
    poses = [Pose(0.01 * step) for step in range(20)]
    base = AmclConfig(kld_err=0.05, laser_max_beams=60, resample_interval=1)
    for particles, goal in ((500, 2.6), (2000, 11.7)):
        config = replace(base, min_particles=particles, max_particles=particles)
        localisation = Localisation(config, np.random.default_rng(1))
        localisation.set_map(grid)
        localisation.set_pose(Pose(2.5, 2.5), np.diag([0.01, 0.01, 0.01]))

        each = _cpu_ms(
            lambda one=localisation: [one.advance(pose, scan) for pose in poses], repetitions
        ) / len(poses)
        yield Row(
            f"amcl update, {particles} particles, 60 beams", "CPU ms", (each,), goal, remark="C++"
        )


def main() -> int:
    """Prints the rows."""
    print(table(kernel_rows()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
