"""Runs the contract of planners on a class: ``python3 -m nav_bundle.check_planner package.module.Class``.

The class is a global planner (it has ``search``) or a local one (``set_plan``, ``decide``, ``cell_costs``); see
``planning.planner.GlobalPlanner`` and ``control.local_planner.LocalPlanner``. It is created as move_base creates it: a
global planner with its configuration, a local one with that and the local costmap's resolution [m]. The
configuration is the class's ``Config``, a dataclass with a default for each field, or else a dict of parameters.
"""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from nav_bundle.base.plugin import PluginError, class_named
from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.control.local_planner import Decision, LocalPlannerError, Situation
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.cost import INSCRIBED
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.maps.grid import FREE, OCCUPIED, Grid
from nav_bundle.planning.planner import PlannerError, path_between

_RESOLUTION = 0.05
_SIDE = 6.0
_START, _GOAL = Pose(1.0, 1.0, 0.0), Pose(5.0, 1.0, 0.5)
_PERIOD = 0.05
_LIMIT = 60.0


class ContractError(AssertionError):
    """A planner breaks its contract; the message says how."""


def room(wall: bool = False, closed: bool = False) -> Costmap:
    """Returns a costmap of a square room, with a ``wall`` across it that has a door unless it is ``closed``."""
    cells = round(_SIDE / _RESOLUTION)
    grid = np.full((cells, cells), FREE, np.int8)
    grid[[0, -1]] = OCCUPIED
    grid[:, [0, -1]] = OCCUPIED
    if wall:
        grid[:, cells // 2] = OCCUPIED
        if not closed:
            grid[3 * cells // 5 : 4 * cells // 5, cells // 2] = FREE
    parameters = {"static_map": True, "robot_radius": 0.2, "inflation_radius": 0.4}
    costmap = Costmap(costmap_config_from_parameters(parameters, "check_planner"))
    costmap.set_map(Grid(_RESOLUTION, Pose(), grid))
    costmap.update(_START, [])
    return costmap


def _require(holds: bool, text: str) -> None:
    if not holds:
        raise ContractError(text)


def _made(kind: type[Any], *arguments: Any) -> Any:
    config_class = getattr(kind, "Config", dict)
    return kind(config_class(), *arguments)


def a_path_leads_from_the_robot_to_the_goal(kind: type[Any]) -> None:
    """A path begins at the robot, ends at the goal with its heading, has no gaps, and crosses no obstacle."""
    costmap = room(wall=True)
    path = path_between(_made(kind), costmap, _START, _GOAL)
    _require(path.ndim == 2 and path.shape[1] == 3, f"a path has shape (n, 3), not {path.shape}")
    _require(bool(np.isfinite(path).all()), "a path has only finite numbers")
    _require(math.dist(path[0, :2], (_START.x, _START.y)) < 0.2, "a path begins at the robot")
    _require(math.dist(path[-1, :2], (_GOAL.x, _GOAL.y)) < 0.1, "a path ends at the goal")
    _require(abs(path[-1, 2] - _GOAL.yaw) < 1.0e-6, "a path ends with the goal's heading")
    gaps = np.hypot(*np.diff(path[:, :2], axis=0).T)
    _require(float(gaps.max()) < 0.5, f"a path has no gaps, not one of {gaps.max():.2f} m")
    worst = max(costmap.cost_of_cell(float(x), float(y)) for x, y, _ in path)
    _require(worst < INSCRIBED, f"a path stays where the robot fits, not in cells of cost {worst}")


def a_goal_without_a_way_raises_planner_error(kind: type[Any]) -> None:
    """Behind a closed wall, beside the map, and from beside the map there is no path."""
    ways = [
        (room(wall=True, closed=True), _START, _GOAL),
        (room(), _START, Pose(-5.0, 1.0)),
        (room(), Pose(-5.0, 1.0), _GOAL),
    ]
    for costmap, start, goal in ways:
        try:
            path_between(_made(kind), costmap, start, goal)
        except PlannerError as error:
            _require(bool(str(error)), "a PlannerError names its reason")
            continue
        raise ContractError(f"from {start} to {goal} there is no way, but a path was returned")


def a_search_works_on_a_copy_of_the_costs(kind: type[Any]) -> None:
    """The costmap may change while a search runs, and the search changes nothing in it."""
    costmap = room(wall=True)
    before = costmap.cells.copy()
    search = _made(kind).search(costmap, _START, _GOAL)
    for _ in range(100_000):
        if search.advance(1000) is not None:
            break
    else:
        raise ContractError("a search ends within 100,000 calls of advance")
    _require(np.array_equal(costmap.cells, before), "a search leaves the costmap as it is")


def _decide(planner: Any, costmap: Costmap, pose: Pose, velocity: Velocity) -> Decision:
    decision = planner.decide(Situation(costmap, pose, velocity, Pose()))
    _require(isinstance(decision, Decision), "decide returns a Decision")
    values = decision.velocity.x, decision.velocity.y, decision.velocity.turn
    _require(all(map(math.isfinite, values)), "a command has only finite numbers")
    return decision


def a_robot_follows_a_plan_to_its_goal_without_contact(kind: type[Any]) -> None:
    """A robot that moves as commanded reaches the end of a straight plan within a minute of its time."""
    costmap = room()
    planner = _made(kind, _RESOLUTION)
    xs = np.arange(_START.x, _GOAL.x, _RESOLUTION)
    plan = np.column_stack([xs, np.full(len(xs), _START.y), np.zeros(len(xs))])
    planner.set_plan(plan)
    pose, velocity, now = _START, STANDSTILL, 0.0
    while now < _LIMIT:
        decision = _decide(planner, costmap, pose, velocity)
        if decision.reached:
            away = pose.distance(Pose(float(xs[-1]), _START.y))
            _require(away < 0.5, f"the goal is reached near it, not {away:.2f} m away")
            return
        velocity = decision.velocity
        step = Pose(velocity.x * _PERIOD, velocity.y * _PERIOD, velocity.turn * _PERIOD)
        pose = pose.compose(step)
        _require(costmap.footprint_cost(pose) >= 0, f"the robot touches nothing, as at {pose}")
        now += _PERIOD
    raise ContractError(f"the goal is reached within {_LIMIT:.0f} s; the robot is at {pose}")


def no_plan_is_a_local_planner_error(kind: type[Any]) -> None:
    """Without a plan, or with one far from the robot, there is no command."""
    planner = _made(kind, _RESOLUTION)
    for plan in (None, np.array([[50.0, 50.0, 0.0], [51.0, 50.0, 0.0]])):
        if plan is not None:
            planner.set_plan(plan)
        try:
            decision = _decide(planner, room(), _START, STANDSTILL)
        except LocalPlannerError as error:
            _require(bool(str(error)), "a LocalPlannerError names its reason")
            continue
        raise ContractError(f"without a plan near the robot it commands {decision.velocity}")


def cell_costs_are_a_table(kind: type[Any]) -> None:
    """Costs of cells are for display: an array of six columns, which may be empty."""
    shape = _made(kind, _RESOLUTION).cell_costs().shape
    _require(len(shape) == 2 and shape[1] == 6, f"cell_costs has shape (n, 6), not {shape}")


Check = Callable[[type[Any]], None]
GLOBAL: tuple[Check, ...] = (
    a_path_leads_from_the_robot_to_the_goal,
    a_goal_without_a_way_raises_planner_error,
    a_search_works_on_a_copy_of_the_costs,
)
LOCAL: tuple[Check, ...] = (
    a_robot_follows_a_plan_to_its_goal_without_contact,
    no_plan_is_a_local_planner_error,
)


def checks_of(kind: type[Any]) -> tuple[Check, ...]:
    """Returns the contract of a global or a local planner.

    Raises:
        PluginError: the class is neither.
    """
    if callable(getattr(kind, "search", None)):
        return GLOBAL
    if all(callable(getattr(kind, name, None)) for name in ("set_plan", "decide")):
        return (*LOCAL, cell_costs_are_a_table) if hasattr(kind, "cell_costs") else LOCAL
    raise PluginError(
        f"{kind.__name__} is no planner: a global one has search, a local one set_plan, decide and cell_costs"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Checks the class that the command line names; returns 0 if it keeps its contract, else 1."""
    parser = argparse.ArgumentParser(
        prog="python3 -m nav_bundle.check_planner",
        description="Checks that a planner of any package keeps the contract of nav_bundle's planners.",
    )
    parser.add_argument("name", metavar="PACKAGE.MODULE.CLASS")
    name = parser.parse_args(arguments).name
    try:
        kind = class_named(name)
        checks = checks_of(kind)
    except PluginError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    failed = 0
    for check in checks:
        fault = ""
        try:
            check(kind)
        except Exception as error:  # noqa: BLE001 - the class is somebody else's, and may raise anything
            fault = f": {type(error).__name__}: {error}"
            failed += 1
        sys.stdout.write(
            f"{'FAILED' if fault else 'ok    '} {check.__name__.replace('_', ' ')}{fault}\n"
        )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
