"""The roadmap made from a map: places where a robot may wait, and the ways between them.

Two robots at places, or on ways that share no end, are at least ``clearance`` apart, so holding places is enough to
keep robots apart. Places are ``spacing`` apart: along the centre line of narrow passages, elsewhere in a triangular
lattice.
"""

import math
import zlib
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from nav_bundle.maps.grid import FREE, Grid
from pioneer_traffic.geometry import Point, distance_between_segments, distance_to_segment

_STEP = 0.05
"""Distance between the points at which a way is checked [m]."""
_PATCH, _PATCHES = 0.25, 20_000
"""Side of a ground patch [m], and the number of patches along x and y after which their numbers repeat."""
_DETOUR = 5
"""A tight way is not added if so few other ways already join its ends."""
_FREE_UP_TO = 25
"""Occupancy up to which a cell is free: map_saver's ``free`` [%]."""
_INSIDE_WALL = 0.3
"""Depth inside a wall at which a robot may still be, because localisation and map are not exact [m]."""
_LONGEST = 2.0
"""Greatest length of a way, as a multiple of the places' spacing."""
_ROUNDING = 1e-6
_HALF_CELL = 0.7
"""Distance from a cell's centre to the wall that it represents [cells]."""

Way = tuple[int, int]
"""Two joined places; the robot drives from the first to the second."""


@dataclass(frozen=True)
class RoadmapConfig:
    """Geometry of places and ways; all in [m]."""

    spacing: float = 1.0  #: minimum distance between places
    #: minimum distance between a robot's way and another robot: more than the robot's largest diameter
    clearance: float = 0.8
    #: preferred free radius around a place: a bit more than a robot needs to turn
    turning_radius: float = 0.41
    #: minimum free radius around a place, for turning; preferred clearance of a way
    driving_radius: float = 0.37
    passing_radius: float = (
        0.28  #: minimum clearance of a way: half the width of the narrowest passage to use
    )


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Distance to the nearest wall [m], shape (rows, cols), row 0 at the bottom; ``corner`` of cell (0, 0) [m].

    ``yaw`` is the direction of the rows in map [rad].
    """

    room: NDArray[np.float32]
    resolution: float
    corner: Point
    yaw: float = 0.0

    @classmethod
    def of(
        cls, free: NDArray[np.bool_], resolution: float, corner: Point, yaw: float = 0.0
    ) -> "FreeSpace":
        """Returns the free space of a map; everything outside counts as wall."""
        padded = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
        room = (np.maximum(padded - _HALF_CELL, 0.0) * resolution).astype(np.float32)
        return cls(room, resolution, corner, yaw)

    @classmethod
    def of_grid(cls, grid: Grid) -> "FreeSpace":
        """Returns the free space of a map: the cells that map_saver would write as free."""
        free = (grid.cells >= FREE) & (grid.cells <= _FREE_UP_TO)
        return cls.of(free, grid.resolution, (grid.origin.x, grid.origin.y), grid.origin.yaw)

    def _turned(self, points: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
        """Returns points, shape (n, 2), turned by ``yaw`` [rad]; exactly the same ones for 0."""
        if yaw == 0.0:
            return points
        cos, sin = math.cos(yaw), math.sin(yaw)
        return points @ np.array([[cos, sin], [-sin, cos]])

    def centres(self, rows: NDArray[np.int64], cols: NDArray[np.int64]) -> NDArray[np.float64]:
        """Returns the centres of cells in map, shape (n, 2)."""
        along = np.stack([cols + 0.5, rows + 0.5], axis=1) * self.resolution
        return self._turned(along, self.yaw) + self.corner

    def cells_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Returns the columns and rows of points, shape (n, 2), which may lie outside the map."""
        along = self._turned(points - self.corner, -self.yaw)
        return np.floor(along / self.resolution).astype(int)

    def room_at(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """Returns the distances from points to the nearest wall, shape (n, 2) -> (n,); 0 outside the map."""
        cells = self.cells_at(points)
        inside = ((cells >= 0) & (cells < self.room.shape[::-1])).all(axis=1)
        cells[~inside] = 0
        return np.where(inside, self.room[cells[:, 1], cells[:, 0]], np.float32(0.0))

    def sees(self, start: Point, end: Point, radius: float) -> bool:
        """Returns whether a disc of ``radius`` [m] can move straight from one point to the other."""
        return bool((self._room_along(start, end) >= radius).all())

    def sees_from_wall(self, start: Point, end: Point, radius: float) -> bool:
        """Returns the same for a disc that starts nearer to a wall than its radius, or a bit inside it.

        It may move away from the wall, not through it.
        """
        room = self._room_along(start, end)
        if room[0] > 0.0:
            return bool((room >= min(radius, float(room[0]))).all())
        outside = np.flatnonzero(room > 0.0)
        if not len(outside) or outside[0] * _STEP > _INSIDE_WALL:
            return False
        return bool((room[outside[0] :] > 0.0).all())

    def _room_along(self, start: Point, end: Point) -> NDArray[np.float32]:
        steps = max(2, math.ceil(math.dist(start, end) / _STEP))
        return self.room_at(np.linspace(start, end, steps))

    def middles(self, radius: float) -> NDArray[np.float64]:
        """Returns the centres of the cells at least ``radius`` [m] from any wall, shape (n, 2)."""
        rows, cols = np.nonzero(self.room >= radius)
        return self.centres(rows, cols)


@dataclass
class Roadmap:
    """Places and the ways between them."""

    places: list[Point]  #: x, y [m], frame map
    neighbours: list[list[int]]  #: for each place, those joined to it by a straight way, ascending
    config: RoadmapConfig = field(default_factory=RoadmapConfig)
    space: FreeSpace | None = None

    @cached_property
    def signature(self) -> int:
        """A checksum: equal on all computers with the same map and parameters."""
        rounded = [(round(x, 3), round(y, 3)) for x, y in self.places]
        return zlib.crc32(repr((rounded, self.neighbours)).encode())

    def distances(self, goal: int) -> list[int]:
        """Returns the number of ways from each place to ``goal``; the number of places if none leads there."""
        found = [len(self.places)] * len(self.places)
        found[goal] = 0
        waiting = deque([goal])
        while waiting:
            place = waiting.popleft()
            for other in self.neighbours[place]:
                if found[other] > found[place] + 1:
                    found[other] = found[place] + 1
                    waiting.append(other)
        return found

    def near(self, start: Point, end: Point, place: int = -1) -> frozenset[int]:
        """Returns what no other robot may hold while one moves off the ways, from ``start`` to ``end``.

        These are the places within the clearance, and one end of each way that comes within it. ``place``, which that
        robot holds, and its ways do not count. Ground patches, numbered after the places, are included: two robots off
        the ways that hold no patch in common are a clearance apart.
        """
        least, reach = self.config.clearance, math.dist(start, end) + 2.5 * self.config.spacing
        about = [
            one
            for one, at in enumerate(self.places)
            if one != place and math.dist(at, start) < reach
        ]
        distance = {one: distance_to_segment(self.places[one], start, end) for one in about}
        found = {one for one in about if distance[one] < least}
        for one in about:
            for other in self.neighbours[one]:
                if other < one or other == place or {one, other} & found:
                    continue
                if (
                    distance_between_segments((self.places[one], self.places[other]), (start, end))
                    < least
                ):
                    found.add(min(one, other, key=lambda end: distance.get(end, math.inf)))
        return frozenset(found | self._patches(start, end))

    def ways_towards(self, point: Point, least: float) -> frozenset[Way]:
        """Returns the ways, each with its direction, that come nearer to a point than ``least`` [m].

        Those that only lead away from the point are not among them.
        """
        reach = _LONGEST * self.config.spacing + least
        found: set[Way] = set()
        for place, start in enumerate(self.places):
            distance = math.dist(point, start)
            if distance >= reach:
                continue
            allowed = min(least, distance) - _ROUNDING
            for other in self.neighbours[place]:
                if distance_to_segment(point, start, self.places[other]) < allowed:
                    found.add((place, other))
        return frozenset(found)

    def _patches(self, start: Point, end: Point) -> set[int]:
        """Returns the numbers of the patches within half the clearance of a straight way."""
        radius = 0.5 * self.config.clearance + _PATCH * math.sqrt(0.5)
        cols, rows = (
            range(
                math.floor((min(pair) - radius) / _PATCH),
                math.ceil((max(pair) + radius) / _PATCH) + 1,
            )
            for pair in zip(start, end, strict=True)
        )
        return {
            _patch_number(col, row, len(self.places))
            for row in rows
            for col in cols
            if distance_to_segment((col * _PATCH, row * _PATCH), start, end) < radius
        }

    def is_near_held(self, held: Sequence[int], point: Point, reach: float) -> bool:
        """Returns whether a point is within ``reach`` [m] of held places or the ways between them, or on held ground.

        Called for each robot by each robot several times a second: the usual case comes first.
        """
        x, y = point
        count = len(self.places)
        for place in held:
            if 0 <= place < count:
                place_x, place_y = self.places[place]
                if math.hypot(place_x - x, place_y - y) <= reach:
                    return True
        places = [place for place in held if 0 <= place < count]
        for place, following in pairwise(places):
            if following in self.neighbours[place]:
                distance = distance_to_segment(point, self.places[place], self.places[following])
                if distance <= reach:
                    return True
        return _patch_number(round(point[0] / _PATCH), round(point[1] / _PATCH), count) in held

    def is_free(self, point: Point) -> bool:
        """Returns whether a point is not in a wall, nor outside the map."""
        return self.space is None or bool(self.space.room_at(np.array([point]))[0] > 0.0)

    def entries(self, point: Point) -> Iterator[int]:
        """Yields the places that a robot at ``point`` can reach in a straight line, the nearest first."""
        order = sorted((math.dist(at, point), place) for place, at in enumerate(self.places))
        for distance, place in order:
            if distance > 2.0 * self.config.spacing:
                return
            if self._sees(point, self.places[place]):
                yield place

    def exits(self, point: Point, reach: float) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Yields places at which a robot can leave the roadmap for a point, the nearest first, and the region of each.

        A region is empty if the place is within ``reach`` [m] of the point.
        """
        for place in self.entries(point):
            region: frozenset[int] = frozenset()
            if math.dist(self.places[place], point) > reach:
                region = self.near(self.places[place], point, place)
            yield place, tuple(sorted(region))

    def _sees(self, start: Point, end: Point) -> bool:
        """Returns whether the way is free; a robot nearer to a wall than allowed may still move away from it."""
        if self.space is None:
            return True
        return self.space.sees_from_wall(start, end, self.config.passing_radius)


def _patch_number(col: int, row: int, places: int) -> int:
    """Returns the number of a ground patch of a roadmap with so many places."""
    return places + (row % _PATCHES) * _PATCHES + col % _PATCHES


def roadmap_from_space(space: FreeSpace, config: RoadmapConfig | None = None) -> Roadmap:
    """Returns the roadmap of the largest connected part of the free space. The result is deterministic."""
    config = config or RoadmapConfig()
    growth = _Growth(space, config)
    growth.grow()
    neighbours = _ways(growth.places, space, config)
    return Roadmap(growth.places, neighbours, config, space)


class _Growth:
    """Grows places from a first one: each new place is joined to an older one by a straight way."""

    def __init__(self, space: FreeSpace, config: RoadmapConfig) -> None:
        self.places: list[Point] = []
        self._space, self._config = space, config
        self._buckets: dict[tuple[int, int], list[Point]] = {}
        angles = np.arange(72) * (math.tau / 72)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._ring = np.concatenate(
            [ring * config.spacing * factor for factor in (1.0, 1.08, 1.16)]
        )
        self._lattice = self._ring[:72:12] * 1.0001

    def grow(self) -> None:
        """Fills the largest part of the free space, beginning in the middle of its narrowest passage."""
        room = np.where(
            largest_part(self._space, self._config.passing_radius), self._space.room, 0.0
        )
        side = 2 * math.ceil(0.5 * self._config.spacing / self._space.resolution) + 1
        middles = (room == ndimage.maximum_filter(room, side)) & (
            room >= self._config.driving_radius
        )
        if not middles.any():
            return
        row, col = np.unravel_index(int(np.argmin(np.where(middles, room, np.inf))), room.shape)
        (first,) = self._space.centres(np.array([row]), np.array([col])).tolist()
        self._add((first[0], first[1]))
        # First the lattice where there is ample room, then the remaining space, finally places behind narrow passages.
        config = self._config
        tiers = (
            (self._lattice, config.turning_radius, config.driving_radius),
            (self._ring, config.turning_radius, config.driving_radius),
            (self._ring, config.driving_radius, config.passing_radius),
        )
        done = [0] * len(tiers)
        while any(count < len(self.places) for count in done):
            tier = next(tier for tier, count in enumerate(done) if count < len(self.places))
            self._extend(self.places[done[tier]], *tiers[tier])
            done[tier] += 1

    def _extend(
        self, origin: Point, offsets: NDArray[np.float64], radius: float, way_radius: float
    ) -> None:
        """Adds the places around ``origin`` that fit, with at least these radii free around the place and its way.

        Those with just enough room come first: the middle of a narrow passage, not the mouth of a bay beside it.
        """
        points = offsets + origin
        room = self._space.room_at(points)
        for index in np.argsort(np.abs(room - self._config.turning_radius), kind="stable").tolist():
            if room[index] < radius:
                continue
            point = (float(points[index, 0]), float(points[index, 1]))
            if self._is_clear(point) and self._space.sees(origin, point, way_radius):
                self._add(point)

    def _bucket(self, point: Point) -> tuple[int, int]:
        return math.floor(point[0] / self._config.spacing), math.floor(
            point[1] / self._config.spacing
        )

    def _add(self, point: Point) -> None:
        self.places.append(point)
        self._buckets.setdefault(self._bucket(point), []).append(point)

    def _is_clear(self, point: Point) -> bool:
        col, row = self._bucket(point)
        least = self._config.spacing - 1e-6
        return all(
            math.dist(other, point) >= least
            for c in (col - 1, col, col + 1)
            for r in (row - 1, row, row + 1)
            for other in self._buckets.get((c, r), ())
        )


def largest_part(space: FreeSpace, radius: float) -> NDArray[np.bool_]:
    """Returns the cells, (rows, cols), of the largest connected part in which a disc of ``radius`` [m] can move."""
    labels, count = ndimage.label(space.room >= radius, structure=np.ones((3, 3)))
    if not count:
        return np.zeros(space.room.shape, bool)
    return labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))


def _ways(places: list[Point], space: FreeSpace, config: RoadmapConfig) -> list[list[int]]:
    """Joins places, the nearest pairs first, unless another place or way comes nearer than ``clearance``.

    Tight ways come last, and only if no other way is nearby.
    """
    found: list[list[int]] = [[] for _ in places]
    at = np.array(places).reshape(-1, 2)
    reach = _LONGEST * config.spacing
    near = [np.flatnonzero(np.hypot(*(at - point).T) < 2.0 * reach).tolist() for point in at]
    pairs = sorted(
        (math.dist(places[one], places[other]), one, other)
        for one in range(len(places))
        for other in near[one]
        if one < other and math.dist(places[one], places[other]) <= reach
    )
    for radius in (config.driving_radius, config.passing_radius):
        for _, one, other in pairs:
            if other in found[one] or not _is_apart(
                one, other, places, near[one], found, config.clearance
            ):
                continue
            tight = radius < config.driving_radius
            if space.sees(places[one], places[other], radius) and not (
                tight and _are_joined(found, one, other)
            ):
                found[one].append(other)
                found[other].append(one)
    return [sorted(neighbours) for neighbours in found]


def _is_apart(
    one: int,
    other: int,
    places: list[Point],
    near: list[int],
    ways: list[list[int]],
    clearance: float,
) -> bool:
    """Returns whether a way between two places keeps clear of all other places and the ways between them."""
    way = places[one], places[other]
    others = [place for place in near if place not in (one, other)]
    if any(distance_to_segment(places[place], *way) < clearance for place in others):
        return False
    segments = ((a, b) for a in others for b in ways[a] if a < b and b not in (one, other))
    return all(
        distance_between_segments((places[a], places[b]), way) >= clearance for a, b in segments
    )


def _are_joined(ways: list[list[int]], one: int, other: int) -> bool:
    """Returns whether a few ways lead from one place to the other."""
    known = {one}
    for _ in range(_DETOUR):
        known |= {end for place in known for end in ways[place]}
    return other in known
