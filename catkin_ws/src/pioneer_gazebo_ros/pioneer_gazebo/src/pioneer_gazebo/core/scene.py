"""The scene for lasers: sections of the static world by height, and outlines of moving bodies."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core.body import Body
from pioneer_gazebo.core.laser import Movers, WallIndex
from pioneer_gazebo.core.pose import IDENTITY
from pioneer_gazebo.core.section import Section, Triangles, section_of
from pioneer_gazebo.core.world import PlacedCollision

LAYER = 0.02
"""Heights are rounded to this [m], so that lasers of similar height share a section."""

SECTIONS_AT_MOST = 16


Seen = tuple[Body, float]
"""A body seen by lasers, and the height [m] of its base frame."""


class Scene:
    """Caches sections and outlines while they are valid."""

    def __init__(self, triangles: Triangles) -> None:
        """Takes the function that reads meshes."""
        self._triangles = triangles
        self._standing: Sequence[PlacedCollision] = ()
        self._walls: dict[int, WallIndex] = {}
        self._movers: dict[int, tuple[tuple[tuple[int, int], ...], Movers]] = {}
        self._outlines: dict[tuple[int, int], NDArray[np.float64]] = {}

    def set_standing(self, standing: Sequence[PlacedCollision]) -> None:
        """Replaces the static world."""
        self._standing = standing
        self._walls.clear()

    def walls(self, height: float) -> WallIndex:
        """Returns the static world's section at ``height`` [m]."""
        layer = round(height / LAYER)
        found = self._walls.get(layer)
        if found is None:
            if len(self._walls) >= SECTIONS_AT_MOST:
                self._walls.clear()
            found = self._walls[layer] = WallIndex(
                Section.joined(
                    section_of(one.collision.shape, one.pose, layer * LAYER, self._triangles) for one in self._standing
                )
            )
        return found

    def movers(self, height: float, seen: Sequence[Seen]) -> Movers:
        """Returns the outlines at ``height`` [m] of all bodies, each in its base frame.

        Outlines assume joints at 0 and a level base.
        """
        layer = round(height / LAYER)
        keys = tuple((id(body), layer - round(base / LAYER)) for body, base in seen)
        known = self._movers.get(layer)
        if known is not None and known[0] == keys:
            return known[1]
        outlines = [self._outline(body, key) for (body, _), key in zip(seen, keys, strict=True)]
        movers = Movers(outlines)
        if len(self._movers) >= SECTIONS_AT_MOST:
            self._movers.clear()
        self._movers[layer] = keys, movers
        return movers

    def _outline(self, body: Body, key: tuple[int, int]) -> NDArray[np.float64]:
        if key not in self._outlines:
            self._outlines[key] = outline_of(body, key[1] * LAYER, self._triangles)
        return self._outlines[key]

    def forget(self, body: Body) -> None:
        """Removes a body's data from the cache."""
        self._movers.clear()
        self._outlines = {key: outline for key, outline in self._outlines.items() if key[0] != id(body)}


def outline_of(body: Body, height: float, triangles: Callable[..., NDArray[np.float64]]) -> NDArray[np.float64]:
    """Returns segments (n, 4) [m] where the plane z = ``height`` of the base frame cuts the body's shapes."""
    frames = [IDENTITY]
    sections = []
    for number, part in enumerate(body.parts):
        if number:
            assert part.joint is not None
            frames.append(frames[part.parent].compose(part.joint.pose))
        for touch in part.touches:
            if not touch.rolling:
                pose = frames[number].compose(touch.collision.pose)
                sections.append(section_of(touch.collision.shape, pose, height, triangles))
    return Section.joined(sections).as_segments()
