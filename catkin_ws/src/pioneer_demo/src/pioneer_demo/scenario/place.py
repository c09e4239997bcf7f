"""Checks that robots have room where they start, and can reach their goals, before anything is started."""

import contextlib
from collections.abc import Iterator, Sequence

from pioneer_demo.scenario.floor import Floor
from pioneer_node.core.document import DocumentError
from pioneer_node.core.reach import PIONEER_RADIUS, areas

Place = tuple[float, float]
"""x, y in the frame ``map`` [m]."""


def check_places(
    floor: Floor,
    starts: Sequence[Place | None],
    goals: Sequence[Sequence[Place]],
    radius: float = PIONEER_RADIUS,
) -> None:
    """Checks each robot's start and goals by the planner's rule; see `pioneer_node.core.reach`.

    Args:
        floor: the map.
        starts: each robot's start; None if the world defines it.
        goals: each robot's goals, in order.
        radius: inscribed radius of their footprints, with padding [m].

    Raises:
        DocumentError: one is in a wall, outside the map, or out of reach; it has the place in a scenario.
    """
    numbers = areas(floor.occupied, floor.resolution, radius)

    def part_at(place: Place) -> int:
        cell = floor.cell(*place)
        if not floor.contains(*cell):
            raise DocumentError("is outside the map")
        if floor.occupied[cell]:
            raise DocumentError("is in a wall")
        if not floor.free[cell]:
            raise DocumentError("is where the map knows nothing")
        # Positions are rounded to cells: a robot beside a wall may stand in the next cell.
        row, col = cell
        around = numbers[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
        if not around.any():
            raise DocumentError(f"is closer than {radius:g} m to a wall")
        return int(numbers[cell] or around.max())

    for robot, (start, own_goals) in enumerate(zip(starts, goals, strict=True)):
        own = None
        if start is not None:
            with _located(f"the start ({start[0]:g}, {start[1]:g})", "robots", robot, "pose"):
                own = part_at(start)
        for number, goal in enumerate(own_goals):
            with _located(f"the goal ({goal[0]:g}, {goal[1]:g})", "robots", robot, "goals", number):
                part = part_at(goal)
                if own is not None and part != own:
                    raise DocumentError("cannot be reached from the robot's place before")
                own = part


@contextlib.contextmanager
def _located(what: str, *place: str | int) -> Iterator[None]:
    """Adds what an error is about, and its place in the scenario."""
    try:
        yield
    except DocumentError as error:
        raise DocumentError(f"{what} {error}", *place) from None
