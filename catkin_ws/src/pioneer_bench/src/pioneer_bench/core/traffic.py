"""Right-of-way trials: narrow floors, uniformly random tours, and the time that each robot needs alone."""

import heapq
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pioneer_traffic.geometry import Point
from pioneer_traffic.roadmap import FreeSpace, Roadmap
from pioneer_traffic.simulation import STEP, Body

RESOLUTION = 0.05
"""Cell size of the narrow floors [m]."""
_ROOM = 0.45
"""Free radius around a start or waypoint [m]."""
_APART = 1.2
"""Minimum distance between starts [m]."""
_ARRIVED = 0.3
_ALONE_ROOM = 0.35
"""Clearance that a robot alone keeps along its path [m]."""

Box = tuple[float, float, float, float]
_CORRIDOR: list[Box] = [(0.0, 0.0, 29.9, 0.9)]
_BAYS: list[Box] = [(x, 0.9, x + 1.6, 2.1) for x in (4.0, 9.0, 14.0, 19.0, 24.0)]
_ENDS: list[Box] = [(-4.0, -1.5, 0.0, 2.4), (29.9, -1.5, 33.9, 2.4)]
_ROOMS: list[Box] = [(x, y, x + 4.0, y + 4.0) for x in (0.0, 6.0, 12.0) for y in (0.0, 6.0, 12.0)]
_PASSAGES: list[Box] = [
    *((x, y + 1.5, x + 2.0, y + 2.4) for x in (4.0, 10.0) for y in (0.0, 6.0, 12.0)),
    *((x + 1.5, y, x + 2.4, y + 2.0) for x in (0.0, 6.0, 12.0) for y in (4.0, 10.0)),
]
NARROW: dict[str, list[Box]] = {
    "swap": [*_CORRIDOR, (14.2, 0.9, 15.8, 2.1)],
    "bays": [*_CORRIDOR, *_BAYS, *_ENDS],
    "cells": [*_ROOMS, *_PASSAGES],
}
"""Floors as unions of free boxes (left, low, right, top) [m]; all passages are 0.9 m wide."""


def narrow_space(name: str) -> FreeSpace:
    """Returns the free space of a narrow floor."""
    boxes = np.array(NARROW[name])
    corner = boxes[:, :2].min(axis=0) - 0.5
    cols, rows = np.ceil((boxes[:, 2:].max(axis=0) + 0.5 - corner) / RESOLUTION).astype(int)
    free = np.zeros((rows, cols), bool)
    for box in boxes:
        left, low, right, top = np.round((box - np.tile(corner, 2)) / RESOLUTION).astype(int)
        free[low:top, left:right] = True
    return FreeSpace.of(free, RESOLUTION, (float(corner[0]), float(corner[1])))


def random_tours(
    space: FreeSpace, roadmap: Roadmap, robots: int, waypoints: int, seed: int
) -> tuple[list[Point], list[list[Point]]]:
    """Returns starts and waypoints, uniformly random over the floor that the roadmap covers."""
    generator, middles = np.random.default_rng(seed), space.middles(_ROOM)

    def point() -> Point:
        while True:
            x, y = middles[generator.integers(len(middles))].tolist()
            if next(roadmap.entries((x, y)), None) is not None:
                return x, y

    starts = list[Point]()
    while len(starts) < robots:
        candidate = point()
        if all(math.dist(candidate, other) >= _APART for other in starts):
            starts.append(candidate)
    return starts, [[point() for _ in range(waypoints)] for _ in range(robots)]


def seconds_alone(space: FreeSpace, roadmap: Roadmap, start: Point, tour: Sequence[Point]) -> float:
    """Returns how long a robot alone on the floor takes for a tour [s]; it drives straight wherever that is free."""
    body, steps = Body(*start), 0
    for waypoint in tour:
        route = _shortened(
            space, [body.position, *_way(roadmap, body.position, waypoint), waypoint]
        )[1:]
        while math.dist(body.position, waypoint) > _ARRIVED:
            while len(route) > 1 and math.dist(body.position, route[0]) < _ARRIVED:
                route.pop(0)
            body.drive(route)
            steps += 1
    return steps * STEP


def _way(roadmap: Roadmap, start: Point, goal: Point) -> list[Point]:
    """Returns the shortest path on the roadmap (Dijkstra)."""
    source, target = next(roadmap.entries(start)), next(roadmap.entries(goal))
    before, heap, known = dict[int, int](), [(0.0, source, source)], set[int]()
    while heap:
        length, place, previous = heapq.heappop(heap)
        if place in known:
            continue
        known.add(place)
        before[place] = previous
        for other in roadmap.neighbours[place]:
            heapq.heappush(
                heap,
                (length + math.dist(roadmap.places[place], roadmap.places[other]), other, place),
            )
    way = [target]
    while way[-1] != source:
        way.append(before[way[-1]])
    return [roadmap.places[place] for place in reversed(way)]


def _shortened(space: FreeSpace, points: list[Point]) -> list[Point]:
    """Returns the path without the points that a straight line can bypass."""
    kept, index = [points[0]], 0
    while index < len(points) - 1:
        seen = (
            last
            for last in range(len(points) - 1, index + 1, -1)
            if _sees(space, points[index], points[last])
        )
        index = next(seen, index + 1)
        kept.append(points[index])
    return kept


def _sees(space: FreeSpace, start: Point, end: Point) -> bool:
    room: NDArray[np.float32] = space.room_at(np.array([start, end]))
    return space.sees(start, end, min(_ALONE_ROOM, *room.tolist()))
