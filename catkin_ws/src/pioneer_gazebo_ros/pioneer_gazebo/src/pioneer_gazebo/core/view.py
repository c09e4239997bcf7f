"""The world as seen by lasers at the current tick."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core.body import Body
from pioneer_gazebo.core.entity import Entity, Mounted, Swinging, swinging_parts
from pioneer_gazebo.core.pose import Pose, heading
from pioneer_gazebo.core.scene import Scene
from pioneer_gazebo.kernels.laser import Sensor


class View:
    """Sections of static and outlines of moving bodies, with the poses of one tick."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._poses: tuple[int, NDArray[np.float64]] = (-1, np.empty((0, 3)))
        self.swinging: list[Swinging] = []

    def add(self, entity: Entity) -> None:
        """Makes an entity visible to all lasers."""
        self.swinging += swinging_parts(entity)
        self.outdate()

    def remove(self, entity: Entity) -> None:
        """Removes an entity."""
        for outline in (entity.outline, *(one.outline for one in self.swinging if one.entity is entity)):
            self._scene.forget(outline)
        self.swinging = [one for one in self.swinging if one.entity is not entity]
        self.outdate()

    def outdate(self) -> None:
        """Discards the poses after something was moved externally."""
        self._poses = (-1, self._poses[1])

    def knows(self, tick: int) -> bool:
        """Returns whether the poses are those of ``tick``."""
        return self._poses[0] == tick

    def update(self, tick: int, poses: Iterable[Pose]) -> None:
        """Sets the poses at a tick: of all entities, then of all swinging parts."""
        rows = [(*pose.position[:2], heading(pose.rotation)) for pose in poses]
        self._poses = tick, np.array(rows).reshape(-1, 3)

    def ranges(
        self, sensor: Pose, mounted: Mounted, own: int, seen: Sequence[tuple[Body, float]]
    ) -> NDArray[np.float64]:
        """Returns a scan's ranges [m]; the array is overwritten by the laser's next scan.

        Args:
            sensor: pose in the world.
            mounted: the ray sensor.
            own: row of the entity that carries it.
            seen: outline and height [m] of each row.
        """
        x, y, height = sensor.position
        around = (self._scene.walls(height), self._scene.movers(height, seen), self._poses[1])
        return mounted.laser.ranges(*around, own, Sensor(x, y, heading(sensor.rotation)))
