"""The scene for lasers: sections of the static world by height, outlines of moving bodies, and poses at one tick."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.laser.laser import Movers, WallIndex
from pioneer_gazebo.laser.laser_kernel import Sensor
from pioneer_gazebo.simulation.beam_plane import LEVEL, BeamPlane
from pioneer_gazebo.simulation.entity import Entity, Mounted, Swinging, swinging_parts
from pioneer_gazebo.world.model import PlacedCollision
from pioneer_gazebo.world.pose import Pose, heading
from pioneer_gazebo.world.section import Section, Triangles, section_of

LAYER = 0.02
"""Heights are rounded to this [m], so that lasers of similar height share a section."""

SECTIONS_AT_MOST = 16


Seen = tuple[Body, Pose]
"""The outline of a body seen by lasers, and the pose of its base frame."""


Heights = tuple[int, ...]
"""The height of each body's base frame, in layers."""


class Scene:
    """The world as seen by lasers; caches sections and outlines while they are valid."""

    def __init__(self, triangles: Triangles) -> None:
        """Takes the function that reads meshes."""
        self._triangles = triangles
        self._plane = BeamPlane(triangles)
        self._obstacles: Sequence[PlacedCollision] = ()
        self._ground: Sequence[PlacedCollision] = ()
        self._walls: dict[int, WallIndex] = {}
        self._movers: dict[int, tuple[Heights, Movers]] = {}
        self._outlines: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._seen: Sequence[Seen] = ()
        self._heights: Heights = ()
        self._poses: NDArray[np.float64] = np.empty((0, 3))
        self.tick = -1  #: the tick of the poses; -1 if they are out of date
        self.swinging: list[Swinging] = []  #: parts of all models that lasers see separately

    def set_standing(
        self, ground: Sequence[PlacedCollision], obstacles: Sequence[PlacedCollision]
    ) -> None:
        """Replaces the static world; a level laser does not see the ground."""
        self._ground, self._obstacles = ground, obstacles
        self._walls.clear()

    def _walls_at(self, layer: int) -> WallIndex:
        found = self._walls.get(layer)
        if found is None:
            if len(self._walls) >= SECTIONS_AT_MOST:
                self._walls.clear()
            found = self._walls[layer] = WallIndex(
                Section.joined(
                    section_of(one.collision.shape, one.pose, layer * LAYER, self._triangles)
                    for one in self._obstacles
                )
            )
        return found

    def _movers_at(self, layer: int) -> Movers:
        """Returns the outlines in a layer of all bodies, each in its base frame, with joints at 0 and a level base."""
        known = self._movers.get(layer)
        if known is not None and known[0] == self._heights:
            return known[1]
        movers = Movers(
            [
                self._outline(body, layer - height)
                for (body, _), height in zip(self._seen, self._heights, strict=True)
            ]
        )
        if len(self._movers) >= SECTIONS_AT_MOST:
            self._movers.clear()
        self._movers[layer] = self._heights, movers
        return movers

    def _outline(self, body: Body, layer: int) -> NDArray[np.float64]:
        """Returns a body's outline in a layer above its base frame."""
        key = (id(body), layer)
        if key not in self._outlines:
            self._outlines[key] = outline_of(body, layer * LAYER, self._triangles)
        return self._outlines[key]

    def add(self, entity: Entity) -> None:
        """Makes an entity visible to all lasers."""
        self.swinging += swinging_parts(entity)
        self._movers.clear()
        self.outdate()

    def remove(self, entity: Entity) -> None:
        """Removes an entity."""
        gone = {
            id(entity.outline),
            *(id(one.outline) for one in self.swinging if one.entity is entity),
        }
        self._movers.clear()
        self._outlines = {
            key: outline for key, outline in self._outlines.items() if key[0] not in gone
        }
        self.swinging = [one for one in self.swinging if one.entity is not entity]
        self.outdate()

    def outdate(self) -> None:
        """Discards the poses after something was moved externally."""
        self.tick = -1

    def update(self, tick: int, seen: Sequence[Seen]) -> None:
        """Sets where all bodies are at a tick: all entities, then all swinging parts."""
        rows = [(*pose.position[:2], heading(pose.rotation)) for _, pose in seen]
        self.tick = tick
        self._seen = seen
        self._heights = tuple(round(pose.position[2] / LAYER) for _, pose in seen)
        self._poses = np.array(rows).reshape(-1, 3)

    def distances(
        self, sensor: Pose, mounted: Mounted, own: int, upright: float
    ) -> NDArray[np.float64]:
        """Returns a scan's true distances [m]; the array is overwritten by the laser's next scan.

        Args:
            sensor: pose in the world.
            mounted: the ray sensor.
            own: row of the entity that carries it.
            upright: z component of the sensor's axis in the robot's base frame: 1 for level, -1 for upside down.
        """
        if abs(upright) < LEVEL:
            return mounted.laser.distances_to(self._cut(sensor, mounted, own))
        x, y, height = sensor.position
        layer = round(height / LAYER)
        around = (self._walls_at(layer), self._movers_at(layer), self._poses)
        planar = Sensor(x, y, heading(sensor.rotation))
        return mounted.laser.distances(*around, own, planar, upside_down=upright < 0.0)

    def _cut(self, sensor: Pose, mounted: Mounted, own: int) -> Section:
        """Returns what the plane of a sensor's beams cuts, in the sensor's frame."""
        others = [one for row, one in enumerate(self._seen) if row != own]
        standing = [*self._ground, *self._obstacles]
        return self._plane.section(sensor, mounted.laser.config.max_range, standing, others)


def outline_of(body: Body, height: float, triangles: Triangles) -> NDArray[np.float64]:
    """Returns segments (n, 4) [m] where the plane z = ``height`` of the base frame cuts the body's shapes."""
    sections = [
        section_of(touch.collision.shape, pose, height, triangles)
        for touch, pose in body.placed()
        if not touch.rolling
    ]
    return Section.joined(sections).as_segments()
