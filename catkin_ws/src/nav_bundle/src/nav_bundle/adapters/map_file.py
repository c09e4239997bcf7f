"""Maps on disk in map_server's format: a YAML file and an image."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from nav_bundle.core.error import MapError
from nav_bundle.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from nav_bundle.core.pose import Pose

MODES = ("trinary", "scale", "raw")
"""How pixels become cells.

trinary: free, occupied or unknown; scale: also the values between; raw: the pixel's value itself (0 … 100).
"""

_FREE_PIXEL, _UNKNOWN_PIXEL, _OCCUPIED_PIXEL = 254, 205, 0
_PLAIN_MODES = {"1", "L", "LA", "P", "PA", "RGB", "RGBA"}


class MapFileMissingError(MapError):
    """The YAML file or its image does not exist."""


class MapMetadataError(MapError):
    """The YAML file does not describe a map."""


class MapImageError(MapError):
    """The image cannot be read."""


@dataclass(frozen=True)
class MapDescription:
    """Content of a map's YAML file."""

    image: Path  #: path of the image
    resolution: float  #: side of a pixel [m]
    origin: Pose  #: pose of the image's lower left corner in the map frame
    occupied_thresh: float  #: a pixel at least this dark (0 … 1) is occupied
    free_thresh: float  #: a pixel less dark than this (0 … 1) is free; between the thresholds, see ``MODES``
    negate: bool  #: white pixels are occupied, not black ones
    mode: str  #: one of ``MODES``


def read_description(path: Path) -> MapDescription:
    """Returns the content of the YAML file at ``path``; the image's path is relative to the file's folder.

    Raises:
        MapFileMissingError: the file cannot be read.
        MapMetadataError: a field is missing or invalid.
    """
    try:
        fields = yaml.safe_load(path.read_text())
    except OSError as error:
        raise MapFileMissingError(f"cannot read the map {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MapMetadataError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from None
    if not isinstance(fields, dict):
        raise MapMetadataError(f"{path} does not describe a map: it needs image, resolution, origin")
    try:
        return _description(path, fields)
    except KeyError as error:
        raise MapMetadataError(f"{path} has no {error.args[0]}") from None
    except (TypeError, ValueError) as error:
        raise MapMetadataError(f"{path} does not describe a map: {error}") from None


def _description(path: Path, fields: dict[str, Any]) -> MapDescription:
    x, y, yaw = (float(value) for value in fields["origin"])
    description = MapDescription(
        path.parent / str(fields["image"]),
        float(fields["resolution"]),
        Pose(x, y, yaw),
        float(fields.get("occupied_thresh", 0.65)),
        float(fields.get("free_thresh", 0.196)),
        bool(fields.get("negate", 0)),
        str(fields.get("mode", "trinary")).lower(),
    )
    if description.mode not in MODES:
        raise ValueError(f"mode must be one of {', '.join(MODES)}, not {description.mode}")
    if not (math.isfinite(description.resolution) and description.resolution > 0.0):
        raise ValueError(f"resolution must be positive, not {description.resolution}")
    if description.free_thresh > description.occupied_thresh:
        raise ValueError("free_thresh must not be above occupied_thresh")
    return description


def read_map(path: Path) -> Grid:
    """Returns the map that the YAML file at ``path`` describes.

    Raises:
        MapError: one of the subclasses above; the message names the file.
    """
    description = read_description(path)
    pixels = _read_pixels(description.image)
    # The image's first row is the map's last (largest y).
    cells = np.ascontiguousarray(_cell_of_pixel(description)[pixels[::-1]])
    return Grid(description.resolution, description.origin, cells)


def _read_pixels(path: Path) -> NDArray[np.uint8]:
    """Returns an image's brightness: the mean of its colours, ignoring alpha; uint8, shape (rows, cols)."""
    try:
        with Image.open(path) as image:
            if image.mode not in _PLAIN_MODES:
                raise MapImageError(
                    f"{path} has an unsupported pixel format (PIL mode {image.mode}); use 8 bits per channel"
                )
            if image.mode in ("L", "1", "LA"):
                return np.asarray(image.convert("L"))
            return np.asarray(image.convert("RGB")).mean(axis=2).round().astype(np.uint8)
    except FileNotFoundError:
        raise MapFileMissingError(f"the map's image {path} does not exist") from None
    except UnidentifiedImageError:
        raise MapImageError(f"{path} is not an image") from None
    except (OSError, SyntaxError, ValueError) as error:
        raise MapImageError(f"cannot read the map's image {path}: {error}") from None


def _cell_of_pixel(description: MapDescription) -> NDArray[np.int8]:
    """Returns the cell value for each brightness 0 … 255, int8, shape (256,)."""
    brightness = np.arange(256)
    if description.mode == "raw":
        return np.where(brightness <= OCCUPIED, brightness, UNKNOWN).astype(np.int8)
    darkness = (brightness if description.negate else 255 - brightness) / 255.0
    low, high = description.free_thresh, description.occupied_thresh
    between = np.full(256, UNKNOWN, float)
    if description.mode == "scale" and high > low:
        between = 1.0 + 98.0 * (darkness - low) / (high - low)
    return np.where(darkness > high, OCCUPIED, np.where(darkness < low, FREE, between)).astype(np.int8)


def write_map(grid: Grid, name: Path, occupied: int = 65, free: int = 25) -> tuple[Path, Path]:
    """Writes ``grid`` as NAME.pgm and NAME.yaml, and returns their paths.

    Args:
        grid: the map.
        name: path without extension; the folder must exist.
        occupied: cells with at least this value (0 … 100) are drawn black.
        free: cells with at most this value are drawn white; all others are grey (unknown).

    Raises:
        MapError: the files cannot be written.
    """
    image, description = Path(f"{name}.pgm"), Path(f"{name}.yaml")
    cells = grid.cells[::-1]
    pixels = np.full(cells.shape, _UNKNOWN_PIXEL, np.uint8)
    pixels[(cells >= 0) & (cells <= free)] = _FREE_PIXEL
    pixels[cells >= occupied] = _OCCUPIED_PIXEL
    fields = {
        "image": image.name,
        "resolution": grid.resolution,
        "origin": [grid.origin.x, grid.origin.y, grid.origin.yaw],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    try:
        Image.fromarray(pixels).save(image, format="PPM")
        description.write_text(yaml.safe_dump(fields, sort_keys=False, default_flow_style=None))
    except OSError as error:
        raise MapError(f"cannot write the map {name}: {error.strerror or error}") from None
    return image, description
