"""3D rigid transforms and a time-buffered transform tree: the part of tf that navigation needs."""

import bisect
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import LARGEST, Pose

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
_UNIT_TOLERANCE = 1.0e-2
"""Tolerance of a quaternion's squared length about 1, as in tf2."""


class TransformError(NavigationError):
    """No transform between two frames at a given time; the message names the frames, the time and the reason."""


class FrameNameError(TransformError):
    """A frame name that no transform can have."""


class DisconnectedError(TransformError):
    """The frames are not connected by transforms, or not yet."""


class ExtrapolationError(TransformError):
    """The frames are connected, but not at the requested time."""

    def __init__(self, message: str, future: bool) -> None:
        super().__init__(message)
        #: true: the time is after the newest transform (wait for more); false: before the oldest (too late)
        self.future = future


@dataclass(frozen=True, slots=True)
class Transform:
    """A rigid transform ``target_from_source``: the pose of the source frame in the target frame."""

    translation: Vector = (0.0, 0.0, 0.0)  #: x, y, z [m]
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)  #: unit quaternion x, y, z, w

    def compose(self, other: "Transform") -> "Transform":
        """Returns a_from_c, given this transform as a_from_b and ``other`` as b_from_c."""
        x, y, z = rotated(self.rotation, other.translation)
        tx, ty, tz = self.translation
        return Transform(
            (tx + x, ty + y, tz + z), quaternion_product(self.rotation, other.rotation)
        )

    def inverse(self) -> "Transform":
        """Returns source_from_target."""
        x, y, z, w = self.rotation
        back = (-x, -y, -z, w)
        px, py, pz = rotated(back, self.translation)
        return Transform((-px, -py, -pz), back)

    def planar(self) -> Pose:
        """Returns the source frame's pose projected onto the target's xy plane: z, roll and pitch are dropped."""
        x, y, z, w = self.rotation
        yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return Pose(self.translation[0], self.translation[1], yaw)

    def upright(self) -> bool:
        """Returns whether the source's z axis points up in the target frame; false for a sensor mounted upside down."""
        x, y, z, w = self.rotation
        return w * w - x * x - y * y + z * z > 0.0

    def matrix(self) -> NDArray[np.float64]:
        """Returns the rotation matrix, shape (3, 3)."""
        columns = (
            rotated(self.rotation, axis)
            for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        )
        return np.array(list(columns)).T

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns ``points`` [m, source frame], shape (n, 3), in the target frame."""
        return points @ self.matrix().T + np.array(self.translation)


def fault_of(parent: str, child: str, transform: Transform) -> str:
    """Returns why parent_from_child is invalid by tf2's rules, or too large; an empty string if it is valid."""
    for frame in (parent, child):
        fault = frame_fault(frame)
        if fault:
            return fault
    if parent == child:
        return "a frame cannot be its own parent"
    if not all(map(math.isfinite, (*transform.translation, *transform.rotation))):
        return (
            f"its numbers must be finite, they are {transform.translation} and {transform.rotation}"
        )
    if any(abs(value) > LARGEST for value in transform.translation):
        return f"its coordinates must be within ±{LARGEST:g} m, they are {transform.translation}"
    if abs(sum(value * value for value in transform.rotation) - 1.0) > _UNIT_TOLERANCE:
        return f"its quaternion must have length 1, it is {transform.rotation}"
    return ""


def frame_fault(frame: str) -> str:
    """Returns why ``frame`` is not a valid frame name; an empty string if it is."""
    if not frame:
        return "a frame's name is empty"
    return f"the frame name {frame!r} holds a NUL" if "\0" in frame else ""


def quaternion_product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Returns the rotation ``second`` followed by ``first``."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotated(rotation: Quaternion, vector: Vector) -> Vector:
    """Returns ``vector`` rotated by the unit quaternion ``rotation``."""
    x, y, z, w = rotation
    vx, vy, vz = vector
    cx, cy, cz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * cx + y * cz - z * cy,
        vy + w * cy + z * cx - x * cz,
        vz + w * cz + x * cy - y * cx,
    )


def interpolated(first: Transform, second: Transform, fraction: float) -> Transform:
    """Interpolates between two transforms (``fraction`` 0 … 1): linear in translation, slerp in rotation."""
    (ax, ay, az), (bx, by, bz) = first.translation, second.translation
    place = (ax + fraction * (bx - ax), ay + fraction * (by - ay), az + fraction * (bz - az))
    return Transform(place, _slerp(first.rotation, second.rotation, fraction))


def _slerp(first: Quaternion, second: Quaternion, fraction: float) -> Quaternion:
    cosine = sum(a * b for a, b in zip(first, second, strict=True))
    sign = 1.0 if cosine >= 0.0 else -1.0
    angle = math.acos(min(1.0, abs(cosine)))
    if angle < 1e-4:  # linear interpolation is exact enough here
        near, far = 1.0 - fraction, sign * fraction
    else:
        near = math.sin((1.0 - fraction) * angle) / math.sin(angle)
        far = sign * math.sin(fraction * angle) / math.sin(angle)
    x, y, z, w = (near * a + far * b for a, b in zip(first, second, strict=True))
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / length, y / length, z / length, w / length)


class Edge:
    """Recent transforms of one child frame to its parent."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent = parent  #: parent frame of the transforms
        self.static = static  #: true: holds one transform, valid at all times
        self._stamps: list[float] = []
        self._transforms: list[Transform] = []

    @property
    def oldest(self) -> float:
        """Stamp [s] of the oldest transform; -inf for a static edge."""
        return -math.inf if self.static else self._stamps[0]

    @property
    def newest(self) -> float:
        """Stamp [s] of the newest transform; inf for a static edge."""
        return math.inf if self.static else self._stamps[-1]

    def insert(self, stamp: float, transform: Transform, keep: float) -> None:
        """Adds a transform in time order, and drops those more than ``keep`` seconds older than the newest."""
        stamps, transforms = self._stamps, self._transforms
        if self.static or not stamps:
            stamps[:], transforms[:] = [stamp], [transform]
            return
        place = bisect.bisect_left(stamps, stamp) if stamp <= stamps[-1] else len(stamps)
        if place < len(stamps) and stamps[place] == stamp:
            transforms[place] = transform
            return
        stamps.insert(place, stamp)
        transforms.insert(place, transform)
        # Trims only at twice the history, so that an insertion into a full history costs nothing on average.
        if stamps[0] < stamps[-1] - 2.0 * keep:
            old = bisect.bisect_left(stamps, stamps[-1] - keep)
            del stamps[:old], transforms[:old]

    def at(self, stamp: float) -> Transform:
        """Returns parent_from_child at ``stamp`` [s], which must lie between ``oldest`` and ``newest``."""
        if self.static:
            return self._transforms[0]
        after = bisect.bisect_left(self._stamps, stamp)
        if self._stamps[after] == stamp:
            return self._transforms[after]
        before, end = self._stamps[after - 1], self._stamps[after]
        return interpolated(
            self._transforms[after - 1], self._transforms[after], (stamp - before) / (end - before)
        )


class TransformTree:
    """A transform tree with limited history. Frame names have no leading slash. Not thread-safe.

    Args:
        keep: history of each edge [s].
    """

    def __init__(self, keep: float = 10.0) -> None:
        self.keep = keep
        self._edges: dict[str, Edge] = {}

    def clear(self) -> None:
        """Drops all transforms that are not static; call it when time jumps back."""
        self._edges = {child: edge for child, edge in self._edges.items() if edge.static}

    def insert(
        self, parent: str, child: str, stamp: float, transform: Transform, static: bool = False
    ) -> bool:
        """Adds parent_from_child at ``stamp`` [s]; returns whether the structure of the tree changed.

        A child with a new parent is detached from the old one, and its history is dropped.
        """
        edge = self._edges.get(child)
        changed = edge is None or edge.parent != parent or edge.static != static
        if edge is None or changed:
            edge = self._edges[child] = Edge(parent, static)
        edge.insert(stamp, transform, self.keep)
        return changed

    def parent(self, frame: str) -> str | None:
        """Returns the parent of ``frame``; None for a root or an unknown frame."""
        edge = self._edges.get(frame)
        return edge.parent if edge else None

    def chain(self, frame: str) -> list[str]:
        """Returns ``frame`` and its ancestors, up to the root or the start of a loop."""
        frames = [frame]
        while (parent := self.parent(frames[-1])) is not None and parent not in frames:
            frames.append(parent)
        return frames

    def path(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """Returns the child frames from ``target``, and those from ``source``, up to the common ancestor.

        Raises:
            DisconnectedError: the frames are not connected.
        """
        up, down = self.chain(source), self.chain(target)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise DisconnectedError(
                f"frames '{target}' and '{source}' are not connected: {self._heard(target, source)}"
            )
        return down[: down.index(common)], up[: up.index(common)]

    def _heard(self, *frames: str) -> str:
        parents = {edge.parent for edge in self._edges.values()}
        silent = [frame for frame in frames if frame not in self._edges and frame not in parents]
        if silent:
            return f"no transform of '{silent[0]}' has arrived"
        return " and ".join(f"'{frame}' ends at '{self.chain(frame)[-1]}'" for frame in frames)

    def lookup(self, target: str, source: str, stamp: float | None = None) -> Transform:
        """Returns target_from_source at ``stamp`` [s]; if None, at the newest time common to all edges.

        Raises:
            DisconnectedError: the frames are not connected.
            ExtrapolationError: an edge between them does not cover ``stamp``.
        """
        below_target, below_source = self.path(target, source)
        if stamp is None:
            stamp = min(
                (self._edges[child].newest for child in below_target + below_source), default=0.0
            )
        to_common = self._climb(below_source, stamp)
        if not below_target:
            return to_common
        return self._climb(below_target, stamp).inverse().compose(to_common)

    def latest(self, target: str, source: str) -> float:
        """Returns the newest stamp [s] at which the two frames are connected; inf if all edges between are static.

        Raises:
            DisconnectedError: the frames are not connected.
        """
        below_target, below_source = self.path(target, source)
        return min(
            (self._edges[child].newest for child in below_target + below_source), default=math.inf
        )

    def _climb(self, children: list[str], stamp: float) -> Transform:
        result = Transform()
        for child in children:
            edge = self._edges[child]
            if stamp > edge.newest or stamp < edge.oldest:
                raise _extrapolation(edge, child, stamp)
            result = edge.at(stamp).compose(result)
        return result


def _extrapolation(edge: Edge, child: str, stamp: float) -> ExtrapolationError:
    future = stamp > edge.newest
    side, bound = ("newest", edge.newest) if future else ("oldest", edge.oldest)
    message = f"transform '{edge.parent}' to '{child}' requested at {stamp:.3f} s; its {side} is at {bound:.3f} s"
    return ExtrapolationError(message, future)
