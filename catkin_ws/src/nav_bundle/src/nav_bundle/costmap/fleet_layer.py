"""The fleet layer: marks the footprint of each other robot as lethal."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import FleetConfig
from nav_bundle.costmap.cost import LETHAL, UNKNOWN
from nav_bundle.costmap.costmap_kernel import Place, fill_polygon
from nav_bundle.costmap.footprint import Footprint, footprint_from_parameters
from nav_bundle.costmap.geometry import EMPTY, Geometry, Window


@dataclass(frozen=True, eq=False)
class _Stamp:
    """One robot's cells, lethal or unknown, and their window."""

    window: Window
    cells: NDArray[np.uint8] = field(repr=False)

    def is_like(self, other: "_Stamp") -> bool:
        return self.window == other.window and np.array_equal(self.cells, other.cells)


class FleetLayer:
    """Marks other robots at their known poses, except in cells that the own robot's footprint covers."""

    def __init__(self, config: FleetConfig, own: Footprint) -> None:
        self.config = config
        self._footprint = (
            footprint_from_parameters(config.footprint, 0.0, config.footprint_padding)
            if config.footprint
            else own
        )
        self._stamps: list[_Stamp] = []

    def place(
        self, geometry: Geometry, others: Iterable[Pose], outline: NDArray[np.float64]
    ) -> Window:
        """Sets the other robots' poses in the costmap's frame; returns the window of cells that may have changed.

        Args:
            geometry: geometry of the costmap.
            others: current poses of the other robots; they replace all earlier ones.
            outline: footprint of the costmap's own robot, shape (n, 2) [m].
        """
        before = self._stamps
        stamps = (self._stamp(geometry, pose, outline) for pose in others)
        self._stamps = [stamp for stamp in stamps if stamp.window]
        changed = EMPTY
        for one, rest in ((before, self._stamps), (self._stamps, before)):
            for stamp in one:
                if not any(stamp.is_like(other) for other in rest):
                    changed = changed.joined(stamp.window)
        return changed

    def _stamp(self, geometry: Geometry, pose: Pose, own: NDArray[np.float64]) -> _Stamp:
        outline = self._footprint.outline(pose)
        (x_0, y_0), (x_1, y_1) = outline.min(axis=0), outline.max(axis=0)
        window = geometry.window_between(x_0, y_0, x_1, y_1)
        if not window:
            return _Stamp(EMPTY, np.empty((0, 0), np.uint8))
        cells = np.full(
            (window.row_1 - window.row_0, window.col_1 - window.col_0), UNKNOWN, np.uint8
        )
        place = geometry.place
        x, y = place.x + window.col_0 * place.resolution, place.y + window.row_0 * place.resolution
        for polygon, value in ((outline, LETHAL), (own, UNKNOWN)):
            fill_polygon(cells, Place(x, y, place.resolution), polygon, value)
        return _Stamp(window, cells)

    def merge(self, master: NDArray[np.uint8], window: Window) -> None:
        """Marks the other robots' cells in the window of ``master`` as lethal."""
        for stamp in self._stamps:
            part = stamp.window.within(window)
            if part:
                top, left = part.row_0 - stamp.window.row_0, part.col_0 - stamp.window.col_0
                stamped = stamp.cells[
                    top : top + part.row_1 - part.row_0, left : left + part.col_1 - part.col_0
                ]
                master[part.slices][stamped == LETHAL] = LETHAL
