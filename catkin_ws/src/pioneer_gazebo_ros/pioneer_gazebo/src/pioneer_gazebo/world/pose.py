"""Rigid poses: position and rotation, with conversions to the forms used by files and engines."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY_ROTATION: Quaternion = (0.0, 0.0, 0.0, 1.0)


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Returns the quaternion (x, y, z, w) of rotations about fixed x, then y, then z [rad], as in SDF and URDF."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def rotated(rotation: Quaternion, vector: Vector) -> Vector:
    """Returns ``vector`` rotated by ``rotation``."""
    x, y, z, w = rotation
    vx, vy, vz = vector
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def added(a: Vector, b: Vector) -> Vector:
    """Returns the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def scaled(a: Vector, factor: float) -> Vector:
    """Returns the vector times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


def opposite(a: Vector) -> Vector:
    """Returns the negated vector."""
    return -a[0], -a[1], -a[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Returns the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def conjugate(rotation: Quaternion) -> Quaternion:
    """Returns the inverse rotation."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def heading(rotation: Quaternion) -> float:
    """Returns the yaw [rad] of a rotation, without its roll and pitch."""
    x, y, z, w = rotation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def planar_pose(x: float, y: float, yaw: float) -> "Pose":
    """Returns the pose at x, y [m] in the plane with heading yaw [rad]."""
    return Pose((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _normalised(rotation: Quaternion) -> Quaternion:
    x, y, z, w = rotation
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not length > 1e-9:
        raise ValueError(f"a rotation needs a quaternion of length 1, not {rotation}")
    return x / length, y / length, z / length, w / length


@dataclass(frozen=True, slots=True)
class Pose:
    """A frame's pose in its parent frame; transforms points of the frame to the parent."""

    position: Vector = (0.0, 0.0, 0.0)  #: x, y, z [m] of the frame's origin
    rotation: Quaternion = IDENTITY_ROTATION  #: unit quaternion (x, y, z, w)

    @classmethod
    def from_rpy(
        cls,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
        roll: float = 0.0,
        pitch: float = 0.0,
        yaw: float = 0.0,
    ) -> Self:
        """Returns the pose at x, y, z [m] with roll, pitch, yaw [rad] about fixed axes."""
        return cls((x, y, z), quaternion_from_rpy(roll, pitch, yaw))

    @classmethod
    def from_quaternion(cls, position: Iterable[float], rotation: Iterable[float]) -> Self:
        """Returns the pose with ``rotation`` (x, y, z, w) normalised.

        Raises:
            ValueError: the quaternion's length is 0 or NaN.
        """
        x, y, z = (float(value) for value in position)
        qx, qy, qz, qw = (float(value) for value in rotation)
        return cls((x, y, z), _normalised((qx, qy, qz, qw)))

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.float64]) -> Self:
        """Returns the pose of a homogeneous 4×4 matrix whose upper left 3×3 block is a rotation."""
        m = np.asarray(matrix, dtype=np.float64)
        candidates = [m[0, 0], m[1, 1], m[2, 2], m[0, 0] + m[1, 1] + m[2, 2]]
        largest = int(np.argmax(candidates))
        quaternion = [0.0, 0.0, 0.0, 0.0]
        if largest == 3:
            quaternion = [
                m[2, 1] - m[1, 2],
                m[0, 2] - m[2, 0],
                m[1, 0] - m[0, 1],
                1.0 + candidates[3],
            ]
        else:
            i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
            quaternion[i] = 1.0 + m[i, i] - m[j, j] - m[k, k]
            quaternion[j] = m[j, i] + m[i, j]
            quaternion[k] = m[k, i] + m[i, k]
            quaternion[3] = m[k, j] - m[j, k]
        return cls.from_quaternion(m[:3, 3], quaternion)

    def matrix(self) -> NDArray[np.float64]:
        """Returns the homogeneous 4×4 float64 matrix."""
        result = np.eye(4)
        for column, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            result[:3, column] = rotated(self.rotation, axis)
        result[:3, 3] = self.position
        return result

    def rpy(self) -> Vector:
        """Returns roll, pitch, yaw [rad] about fixed axes; at a pitch of ±π/2 the roll is 0."""
        x, y, z, w = self.rotation
        sin_pitch = 2.0 * (w * y - z * x)
        if abs(sin_pitch) > 1.0 - 1e-12:
            pitch = math.copysign(math.pi / 2, sin_pitch)
            return (
                0.0,
                pitch,
                math.remainder(-2.0 * math.copysign(1.0, sin_pitch) * math.atan2(x, w), math.tau),
            )
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        return roll, math.asin(sin_pitch), heading(self.rotation)

    @property
    def yaw(self) -> float:
        """The heading [rad], as in `rpy`."""
        return self.rpy()[2]

    def compose(self, other: "Pose") -> "Pose":
        """Returns ``other``, a pose in this frame, in the parent frame: ``a_from_c = a_from_b.compose(b_from_c)``."""
        return Pose(
            self.transform(other.position), _normalised(_product(self.rotation, other.rotation))
        )

    def inverse(self) -> "Pose":
        """Returns the parent frame's pose in this frame."""
        back = conjugate(self.rotation)
        return Pose(opposite(rotated(back, self.position)), back)

    def transform(self, point: Vector) -> Vector:
        """Transforms ``point`` [m] from this frame to the parent frame."""
        return added(rotated(self.rotation, point), self.position)


IDENTITY = Pose()
"""The parent frame itself."""


def between(a: Pose, b: Pose, part: float) -> Pose:
    """Interpolates from ``a`` to ``b`` by ``part`` (0 … 1): linear position, normalised-lerp rotation the short way."""
    (ax, ay, az), (bx, by, bz) = a.position, b.position
    ra, rb = a.rotation, b.rotation
    sign = 1.0 if sum(p * q for p, q in zip(ra, rb, strict=True)) >= 0 else -1.0
    x, y, z, w = (p + part * (sign * q - p) for p, q in zip(ra, rb, strict=True))
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return Pose(
        (ax + part * (bx - ax), ay + part * (by - ay), az + part * (bz - az)),
        (x / length, y / length, z / length, w / length),
    )
