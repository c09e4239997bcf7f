"""Waypoints for a robot without goals: the initial poses of its world, in turn."""

from collections.abc import Mapping, Sequence

Place = tuple[float, float, float]
"""x, y [m] and heading [rad] in ``map``."""


def tour(places: Sequence[Place], robot: int, robots: int, count: int) -> list[Place]:
    """Returns ``count`` places for robot number ``robot`` (from 1) of ``robots``.

    In each round every robot advances by the same number of places in the list, so that no two robots share a place.
    Free places come first.
    """
    step = robots % len(places) or len(places) // 2 or 1
    return [places[(robot - 1 + step * leg) % len(places)] for leg in range(1, count + 1)]


def places_from_mapping(parameters: Mapping[str, object]) -> list[Place]:
    """Returns the initial poses found in the root of a parameter server, ``pioneer1`` first.

    Ignores entries that are not initial poses.
    """
    found: list[Place] = []
    while (
        isinstance(entry := parameters.get(f"pioneer{len(found) + 1}"), Mapping)
        and {"x", "y", "a"} <= entry.keys()
    ):
        found.append((float(entry["x"]), float(entry["y"]), float(entry["a"])))
    return found
