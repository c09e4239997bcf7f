"""A layered costmap that recomputes only the cells that changed."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import (
    CostmapConfig,
    FleetConfig,
    InflationConfig,
    ObstacleConfig,
    StaticConfig,
    VoxelConfig,
)
from nav_bundle.costmap.cost import FREE, LETHAL, UNKNOWN, cells_of_distance
from nav_bundle.costmap.fleet_layer import FleetLayer
from nav_bundle.costmap.footprint_kernel import footprint_cost
from nav_bundle.costmap.geometry import EMPTY, Cells, Geometry, Window
from nav_bundle.costmap.layer import InflationLayer, Observation, ObstacleLayer, StaticLayer
from nav_bundle.costmap.obstacle_kernel import Sizes, keep_robot_sized
from nav_bundle.costmap.voxel_layer import VoxelLayer
from nav_bundle.maps.grid import Grid

_KNOWN = 0.3
NARROWEST_ROBOT, _WIDEST = 0.32, 0.6
"""Range of the distance between two points on one robot [m]: a Pioneer is 0.4 m wide and 0.5 m long."""
_JOINED, _TOO_WIDE = 0.3, 1.2
"""Points less than the first distance [m] apart are on one obstacle; with a diagonal of more than the second it is no
robot."""


class Costmap:
    """Costs around a robot, either fixed in a map's frame or in a window that rolls with the robot.

    Not thread-safe: only one owner may update and read it.
    """

    def __init__(self, config: CostmapConfig) -> None:
        self.config = config  #: the current parameters
        self.footprint = config.outline()  #: the robot's padded footprint
        # By index in the configuration; disabled ones, too, so that they have their maps when they are enabled.
        self._static: dict[int, StaticLayer] = {}
        self._keep_maps()
        self._obstacles: dict[int, ObstacleLayer] = {}  # by index in the configuration
        self._fleet: list[FleetLayer] = []
        self._layers: list[StaticLayer | ObstacleLayer | FleetLayer | InflationLayer] = []
        self._margin = 0
        self._pending = EMPTY
        self.geometry = self._own_geometry()  #: origin, resolution and size of the cells
        self.cells: Cells = np.empty((0, 0), np.uint8)  #: uint8, shape (rows, cols), C-contiguous
        self._resize(self.geometry)

    def _own_geometry(self) -> Geometry:
        """Returns the geometry that the parameters give when no map does."""
        config = self.config
        rows = cells_of_distance(config.height, config.resolution)
        cols = cells_of_distance(config.width, config.resolution)
        return Geometry(config.origin_x, config.origin_y, config.resolution, rows, cols)

    def configure(self, config: CostmapConfig) -> None:
        """Applies another configuration; keeps map and obstacles unless size or resolution change."""
        before, self.config = self.config, config
        self.footprint = config.outline()
        self._keep_maps()
        shaped = ("width", "height", "resolution", "origin_x", "origin_y")
        changed = any(getattr(config, name) != getattr(before, name) for name in shaped)
        if changed and (config.rolling_window or self._map_geometry() is None):
            self._resize(self._own_geometry())
        else:
            self._make_layers()

    @property
    def _default(self) -> int:
        """Cost of a cell without any observation."""
        return UNKNOWN if self.config.track_unknown_space else FREE

    def _keep_maps(self) -> None:
        """Takes the static layers of the configuration; each keeps its map if it would convert it to the same costs."""
        known = self._static
        self._static = {}
        for index, config in enumerate(self.config.layers):
            if isinstance(config, StaticConfig):
                layer = known.get(index)
                if layer is None or replace(layer.config, enabled=config.enabled) != config:
                    layer = StaticLayer(config)
                layer.config = config
                self._static[index] = layer

    @property
    def _maps(self) -> list[StaticLayer]:
        """The enabled static layers that have a map."""
        return [
            layer
            for layer in self._static.values()
            if layer.config.enabled and layer.place is not None
        ]

    def _map_geometry(self) -> Geometry | None:
        """Returns the geometry of the first static layer's map; None without a map."""
        places = [layer.place for layer in self._static.values() if layer.place is not None]
        return replace(places[0]) if places else None

    def missing_maps(self) -> list[str]:
        """Returns the topics of enabled static layers that have no map yet."""
        layers = self._static.values()
        return [
            layer.config.map_topic
            for layer in layers
            if layer.config.enabled and layer.place is None
        ]

    @property
    def ready(self) -> bool:
        """True once every enabled static layer has its map."""
        return not self.missing_maps()

    def takes_map(self, topic: str) -> bool:
        """Returns whether a static layer takes a map from ``topic``: it has none yet, or not ``first_map_only``."""
        layers = self._static.values()
        return any(layer.takes_map for layer in layers if layer.config.map_topic == topic)

    def set_map(self, grid: Grid, topic: str | None = None) -> None:
        """Sets the map of the static layers that take one from ``topic``; None: of all.

        A costmap that does not roll takes size and resolution of the first static layer's map. It drops its obstacles
        only if that changes them.
        """
        for layer in self._static.values():
            if layer.takes_map and (topic is None or layer.config.map_topic == topic):
                layer.set_map(grid)
        geometry = self._map_geometry()
        if self.config.rolling_window or geometry is None:
            return
        if geometry != self.geometry:
            self._resize(geometry)
        for layer in self._static.values():
            layer.fit(geometry)
        self._pending = self.geometry.everything

    def _resize(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self.cells = np.full((geometry.rows, geometry.cols), self._default, np.uint8)
        self._obstacles = {}
        self._make_layers()

    def _make_layers(self) -> None:
        """Creates new layers; each obstacle layer keeps the cells of its predecessor."""
        self._layers = []
        known, self._obstacles = self._obstacles, {}
        for index, config in enumerate(self.config.layers):
            if not config.enabled:
                continue
            layer = self._layer(index, config)
            if isinstance(layer, ObstacleLayer):
                self._obstacles[index] = layer
                if index in known:
                    layer.succeed(known[index])
            self._layers.append(layer)
        self._fleet = [layer for layer in self._layers if isinstance(layer, FleetLayer)]
        self._margin = max(
            [layer.radius for layer in self._layers if isinstance(layer, InflationLayer)], default=0
        )
        self._pending = self.geometry.everything

    def _layer(
        self, index: int, config: object
    ) -> "StaticLayer | ObstacleLayer | FleetLayer | InflationLayer":
        match config:
            case StaticConfig():
                return self._static[index]
            case InflationConfig():
                return InflationLayer(config, self.footprint, self.geometry.resolution)
            case FleetConfig():
                return FleetLayer(config, self.footprint)
            case VoxelConfig():
                return VoxelLayer(config, self.geometry.rows, self.geometry.cols)
            case ObstacleConfig():
                return ObstacleLayer(config, self.geometry.rows, self.geometry.cols)
        raise TypeError(f"no layer for {config!r}")

    def update(
        self,
        pose: Pose,
        observations: Sequence[Observation],
        others: Sequence[Pose] = (),
        here_from_map: Pose | Mapping[str, Pose] | None = None,
    ) -> Window:
        """Updates the costs; returns the window of cells that may have changed.

        Args:
            pose: the robot's pose in the costmap's frame; a rolling window is centred on it.
            observations: the current observations of each source, in the costmap's frame.
            others: other robots' poses in the costmap's frame, for the fleet layer.
            here_from_map: pose of the map's frame in the costmap's, for maps in a rolling window; if it is not the same
                for all, by topic of the map. Default: identity.
        """
        changed, self._pending = self._pending, EMPTY
        if self.config.rolling_window:
            moved = self._centre(pose)
            if self._lie(here_from_map or Pose()) or moved:
                changed = self.geometry.everything
        outline = self.footprint.outline(pose)
        for layer in self._obstacles.values():
            changed = changed.joined(layer.observe(self.geometry, observations, outline))
        for fleet in self._fleet:
            changed = changed.joined(fleet.place(self.geometry, others, outline))
        if changed:
            changed = changed.grown(self._margin, self.geometry.everything)
            self.cells[changed.slices] = self._default
            for merged in self._layers:
                merged.merge(self.cells, changed)
        return changed

    def _lie(self, here_from_map: Pose | Mapping[str, Pose]) -> bool:
        """Lays the maps into the window; returns whether any cell of them changed."""
        changed = False
        for layer in self._static.values():
            if layer.place is not None:
                own = (
                    here_from_map
                    if isinstance(here_from_map, Pose)
                    else here_from_map[layer.config.map_topic]
                )
                changed = layer.lie(self.geometry, own) or changed
        return changed

    def _centre(self, pose: Pose) -> bool:
        """Moves the window by whole cells so that the robot is in its centre; returns whether it moved."""
        place = self.geometry
        right = place.col_of(pose.x) - place.cols // 2
        down = place.row_of(pose.y) - place.rows // 2
        if right == 0 and down == 0:
            return False
        place.origin_x += right * place.resolution
        place.origin_y += down * place.resolution
        for layer in self._obstacles.values():
            layer.shift(down, right)
        return True

    def clear_outside(self, pose: Pose, side: float, names: Collection[str] = ()) -> None:
        """Clears sensor data outside the square of ``side`` [m] around ``pose``; effective at the next update.

        Args:
            pose: centre of the square, in the costmap's frame.
            side: its length [m].
            names: the obstacle layers to clear; empty for all.
        """
        for layer in self._named(names):
            layer.clear_outside(self.geometry, pose, side)
        self._pending = self.geometry.everything

    def clear_inside(self, pose: Pose, side: float, names: Collection[str] = ()) -> None:
        """Clears sensor data inside the square of ``side`` [m] around ``pose``; see ``clear_outside``."""
        for layer in self._named(names):
            layer.clear_inside(self.geometry, pose, side)
        self._pending = self.geometry.everything

    def _named(self, names: Collection[str]) -> list[ObstacleLayer]:
        """Returns the obstacle layers with these names; all without names."""
        layer_names = self.config.layer_names
        return [
            layer
            for index, layer in self._obstacles.items()
            if not names or layer_names[index] in names
        ]

    def open_around(self, pose: Pose, side: float) -> None:
        """Makes the square of ``side`` [m] around ``pose`` free until the next update."""
        half = side / 2.0
        window = self.geometry.window_between(
            pose.x - half, pose.y - half, pose.x + half, pose.y + half
        )
        self.cells[window.slices] = FREE
        self._pending = self.geometry.everything

    def reset(self) -> None:
        """Clears all sensor data; effective at the next update."""
        for layer in self._obstacles.values():
            layer.clear()
        self._pending = self.geometry.everything

    def cost_at(self, distance: float) -> int:
        """Returns the cost of a free cell whose nearest obstacle is ``distance`` [m] away."""
        return max(
            (
                layer.cost_at(distance)
                for layer in self._layers
                if isinstance(layer, InflationLayer)
            ),
            default=0,
        )

    def footprint_cost(self, pose: Pose) -> int:
        """Returns the highest cost under the robot's footprint at ``pose``: -1 lethal, -2 unknown, -3 off the grid."""
        return footprint_cost(
            self.cells, self.geometry.place, self.footprint.vertices, pose.x, pose.y, pose.yaw
        )

    def cost_of_cell(self, x: float, y: float) -> int:
        """Returns the cost of the cell at ``x, y`` [m]; free outside the grid."""
        cell = self.geometry.cell_at(x, y)
        return int(self.cells[cell]) if self.geometry.contains(cell) else FREE

    def marked(self) -> NDArray[np.float64]:
        """Returns the centres of all cells that sensors have marked as obstacles, shape (n, 2) [m]."""
        place = self.geometry
        cells = [
            np.argwhere(layer.cells == LETHAL)[:, ::-1] + 0.5 for layer in self._obstacles.values()
        ]
        return np.concatenate([np.empty((0, 2)), *cells]) * place.resolution + (
            place.origin_x,
            place.origin_y,
        )

    def goal_fault(self, goal: Pose) -> str:
        """Returns why the static map rules out ``goal``; empty if it does not.

        Obstacles seen only by sensors do not count, since they may move away. A costmap that rolls or has no map
        rules out no goal.
        """
        if self.config.rolling_window or not self._maps:
            return ""
        place, radius = self.geometry, self.footprint.inscribed_radius
        row, col = cell = place.cell_at(goal.x, goal.y)
        if not place.contains(cell):
            right, top = (
                place.origin_x + place.cols * place.resolution,
                place.origin_y + place.rows * place.resolution,
            )
            spans = (
                f"x from {place.origin_x:g} to {right:g} and y from {place.origin_y:g} to {top:g} m"
            )
            return f"The goal ({goal.x:.2f}, {goal.y:.2f}) is outside the map, which spans {spans}."
        reach = int(radius / place.resolution)
        part = place.window_around(cell, reach)
        rows, cols = np.ogrid[
            part.row_0 - row : part.row_1 - row, part.col_0 - col : part.col_1 - col
        ]
        lethal = np.zeros((part.row_1 - part.row_0, part.col_1 - part.col_0), bool)
        for layer in self._maps:
            assert layer.cells is not None
            lethal |= layer.cells[part.slices] == LETHAL
        if not np.any(lethal & (rows**2 + cols**2 <= reach**2)):
            return ""
        position = f"({goal.x:.2f}, {goal.y:.2f})"
        return f"The goal {position} is in an obstacle of the map, or less than {radius:.2f} m from one."

    def unmapped(
        self, pose: Pose, reach: float, width: float = NARROWEST_ROBOT
    ) -> NDArray[np.float64]:
        """Returns marked obstacles that are not in the map: points (n, 2) [m] within ``reach`` [m] of ``pose``.

        Cells within 0.3 m of a lethal cell of the map count as mapped. Obstacles narrower than ``width`` [m], or much
        wider than a robot, are left out: they cannot be robots and need not be given way. Empty without a map or with
        ``reach`` 0.
        """
        if not self._maps or reach <= 0.0:
            return np.empty((0, 2))
        place, margin = self.geometry, cells_of_distance(reach, self.geometry.resolution)
        part = place.window_around(place.cell_at(pose.x, pose.y), margin)
        if not part:
            return np.empty((0, 2))
        seen = np.zeros(self.cells[part.slices].shape, bool)
        for layer in self._obstacles.values():
            seen |= layer.cells[part.slices] == LETHAL
        if not seen.any():
            return np.empty((0, 2))
        for mapped in self._maps:
            seen &= ~mapped.near(part, cells_of_distance(_KNOWN, place.resolution))
        marks = seen.view(np.uint8)
        limits = (_JOINED, width, _WIDEST, _TOO_WIDE)
        keep_robot_sized(marks, Sizes(*(limit / place.resolution for limit in limits)))
        cells = np.argwhere(marks)[:, ::-1] + (part.col_0 + 0.5, part.row_0 + 0.5)
        points = cells * place.resolution + (place.origin_x, place.origin_y)
        return np.ascontiguousarray(points)
