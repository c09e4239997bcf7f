"""Camera model: pinhole intrinsics, depth to points, noise."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.world.robot import Camera

Picture = NDArray[np.uint8]
"""Shape (height, width, 3): red, green, blue; row 0 is the top."""

Depth = NDArray[np.float32]
"""Shape (height, width) [m]: depth along the camera's axis; +inf for no hit within range."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole camera with square pixels: focal length and principal point [pixel]; pixel centres are at integers."""

    focal: float
    x: float
    y: float


def intrinsics_of(camera: Camera) -> Intrinsics:
    """Returns the intrinsics; the horizontal field of view spans the image from edge to edge."""
    focal = camera.width / (2.0 * math.tan(camera.horizontal_fov / 2.0))
    return Intrinsics(focal, (camera.width - 1) / 2.0, (camera.height - 1) / 2.0)


def vertical_fov(camera: Camera) -> float:
    """Returns the vertical field of view [rad]."""
    return 2.0 * math.atan(math.tan(camera.horizontal_fov / 2.0) * camera.height / camera.width)


def points_of(depth: Depth, camera: Camera) -> NDArray[np.float32]:
    """Returns the 3D point of each pixel: x to the right, y down, z ahead [m], shape (height, width, 3)."""
    lens = intrinsics_of(camera)
    x = (np.arange(camera.width, dtype=np.float32) - np.float32(lens.x)) / np.float32(lens.focal)
    y = (np.arange(camera.height, dtype=np.float32) - np.float32(lens.y)) / np.float32(lens.focal)
    met = np.where(np.isfinite(depth), depth, np.float32(np.nan))
    return np.stack([met * x[None, :], met * y[:, None], met], axis=-1)


def noisy(picture: Picture, stddev: float, generator: np.random.Generator) -> Picture:
    """Returns the picture with Gaussian noise on every value; ``stddev`` is a fraction of full scale."""
    if stddev <= 0:
        return picture
    noise = generator.standard_normal(picture.shape, dtype=np.float32) * np.float32(stddev * 255.0)
    return np.clip(picture + noise, 0.0, 255.0).astype(np.uint8)
