"""Waypoints for a robot that has none: the initial poses of its world, in turn."""

from collections.abc import Mapping, Sequence

Place = tuple[float, float, float]
"""x, y [m] and heading [rad] in ``map``."""


def tour(places: Sequence[Place], robot: int, robots: int, count: int) -> list[Place]:
    """Returns ``count`` places for robot number ``robot`` (from 1) of ``robots``.

    In each round every robot goes as many places further along the list, so that no two robots of a round have the
    same one; free places come first.
    """
    step = robots % len(places) or len(places) // 2 or 1
    return [places[(robot - 1 + step * leg) % len(places)] for leg in range(1, count + 1)]


def places_from_mapping(parameters: Mapping[str, object]) -> list[Place]:
    """Returns the initial poses among a parameter server's root, ``pioneer1`` first.

    Entries that are no initial pose do not count.
    """
    found: list[Place] = []
    while isinstance(entry := parameters.get(f"pioneer{len(found) + 1}"), Mapping) and {"x", "y", "a"} <= entry.keys():
        found.append((float(entry["x"]), float(entry["y"]), float(entry["a"])))
    return found
