"""Maps on disk in map_server's format: a YAML file and an image."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from nav_bundle.base.error import MapError
from nav_bundle.base.pose import Pose
from nav_bundle.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid

MODES = ("trinary", "scale", "raw")
"""How pixels become cells.

trinary: free, occupied or unknown. scale: also the values between; where a pixel is transparent, these are unknown.
raw: the pixel's value itself as an int8, so that 150 becomes -106, as from ROS' map_server.
"""

_FREE_PIXEL, _UNKNOWN_PIXEL, _OCCUPIED_PIXEL = 254, 205, 0
_GREY_MODES = {"1", "L", "LA"}
_COLOUR_MODES = {"P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr"}
_WIDE_MODES = {"I", "I;16", "I;16B", "I;16L"}
"""16 bits per pixel, of which the higher eight count."""
_TRANSPARENT_MODES = {"LA", "PA", "RGBA"}
_MOST_PIXELS = 2**30
"""A larger image would take several gigabytes here and in every subscriber."""


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
    free_thresh: float
    """A pixel less dark than this (0 … 1) is free, unless it is occupied; between the thresholds, see ``MODES``."""
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
        raise MapMetadataError(
            f"{path} is not valid YAML: {' '.join(str(error).split())}"
        ) from None
    if not isinstance(fields, dict):
        raise MapMetadataError(
            f"{path} does not describe a map: it needs image, resolution, origin"
        )
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
        _flag(fields.get("negate", 0)),
        str(fields.get("mode", "trinary")).lower(),
    )
    if description.mode not in MODES:
        raise ValueError(f"mode must be one of {', '.join(MODES)}, not {description.mode}")
    if not (math.isfinite(description.resolution) and description.resolution > 0.0):
        raise ValueError(f"resolution must be positive, not {description.resolution}")
    if not all(math.isfinite(value) for value in (x, y, yaw)):
        raise ValueError(f"origin must be three finite numbers, not {fields['origin']}")
    if math.isnan(description.free_thresh) or math.isnan(description.occupied_thresh):
        raise ValueError("free_thresh and occupied_thresh must be numbers, not nan")
    return description


def _flag(value: Any) -> bool:
    """Returns a flag that may be written as 0, 1, true or false, in quotes or without."""
    if isinstance(value, str):
        value = yaml.safe_load(value)
    if not isinstance(value, int):  # True and False are integers, too
        raise ValueError(f"negate must be 0 or 1, not {value!r}")
    return bool(value)


def read_map(path: Path) -> Grid:
    """Returns the map that the YAML file at ``path`` describes.

    Raises:
        MapError: one of the subclasses above; the message names the file.
    """
    description = read_description(path)
    image = _read_image(description.image)
    cells = _cell_of_sum(description, image.channels)[image.sums]
    if description.mode == "scale" and image.transparent is not None:
        between = (cells > FREE) & (cells < OCCUPIED)
        cells[between & image.transparent] = UNKNOWN
    # The image's first row is the map's last (largest y).
    return Grid(description.resolution, description.origin, np.ascontiguousarray(cells[::-1]))


@dataclass(frozen=True)
class _MapImage:
    """Pixels of a map's image."""

    sums: NDArray[np.uint8] | NDArray[np.uint16]
    """Sum of a pixel's colours, each 0 … 255, alpha left out; shape (rows, cols). Grey ones stay bytes."""
    channels: int  #: how many colours a sum is of
    transparent: (
        NDArray[np.bool_] | None
    )  #: where alpha is 0, shape (rows, cols); None: the image has no alpha


def _read_image(path: Path) -> _MapImage:
    """Returns the image at ``path``.

    Raises:
        MapError: a subclass, whose message names the file.
    """
    try:
        with _opened(path) as image:
            return _pixels_of(path, image)
    except FileNotFoundError:
        raise MapFileMissingError(f"the map's image {path} does not exist") from None
    except UnidentifiedImageError:
        raise MapImageError(f"{path} is not an image") from None
    except MemoryError:
        raise MapImageError(f"{path} does not fit into this machine's memory") from None
    except (OSError, SyntaxError, ValueError) as error:
        raise MapImageError(f"cannot read the map's image {path}: {error}") from None


def _opened(path: Path) -> Image.Image:
    """Returns the image, its pixels not read yet.

    PIL's own limit is made for images from the network, and below the size of published maps; ours replaces it.
    """
    limit = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None
    try:
        image = Image.open(path)
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    width, height = image.size
    if width * height > _MOST_PIXELS:
        image.close()
        raise MapImageError(
            f"{path} has {width} x {height} pixels, more than {_MOST_PIXELS} in all; use a coarser map"
        )
    return image


def _pixels_of(path: Path, image: Image.Image) -> _MapImage:
    transparent = None
    if image.mode in _TRANSPARENT_MODES:
        transparent = np.asarray(image.getchannel("A")) == 0
    if image.mode in _WIDE_MODES:
        return _MapImage(
            (np.asarray(image).astype(np.int64) >> 8).clip(0, 255).astype(np.uint8), 1, None
        )
    if image.mode in _GREY_MODES:
        return _MapImage(np.asarray(image.convert("L")), 1, transparent)
    if image.mode in _COLOUR_MODES:
        return _MapImage(
            np.asarray(image.convert("RGB")).sum(axis=2, dtype=np.uint16), 3, transparent
        )
    raise MapImageError(
        f"{path} has an unsupported pixel format (PIL mode {image.mode}); use 8 bits per channel"
    )


def _cell_of_sum(description: MapDescription, channels: int) -> NDArray[np.int8]:
    """Returns the cell value for each sum of a pixel's colours, int8, shape (255 * channels + 1,)."""
    brightness = np.arange(255 * channels + 1) / channels
    if description.negate:
        brightness = 255.0 - brightness
    if description.mode == "raw":
        return brightness.astype(np.uint8).view(np.int8)
    darkness = (255.0 - brightness) / 255.0
    low = description.free_thresh
    high = description.occupied_thresh
    between = np.full(darkness.shape, UNKNOWN, float)
    if description.mode == "scale" and high > low:
        between = 1.0 + 98.0 * (darkness - low) / (high - low)
    return np.where(darkness > high, OCCUPIED, np.where(darkness < low, FREE, between)).astype(
        np.int8
    )


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
