"""Reads the maps written by ``world_to_map``, without numpy, whose import would delay every robot's start."""

import re
from pathlib import Path

import yaml

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.fleet.fleet import DrawnMap


def read_map(path: Path) -> DrawnMap | None:
    """Returns the map whose YAML file is ``path``; None if its image is no binary PGM, is rotated, or is negated.

    Raises:
        DescriptionError: the map cannot be read.
    """
    try:
        fields = yaml.safe_load(path.read_text())
        content = (path.parent / fields["image"]).read_bytes()
        x, y, yaw = map(float, fields["origin"])
        resolution, free, occupied = (
            float(fields[key]) for key in ("resolution", "free_thresh", "occupied_thresh")
        )
        negated = bool(int(fields.get("negate", 0)))
    except (OSError, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise DescriptionError(f"cannot read the map {path}: {error}") from None
    header = re.match(rb"P5\s+(?:#.*\s+)*(\d+)\s+(\d+)\s+255\s", content)
    if header is None or yaw or negated:
        return None
    cols, rows = int(header[1]), int(header[2])
    if len(content) - header.end() < rows * cols:
        raise DescriptionError(f"cannot read the map {path}: its image ends too early")
    pixels = content[header.end() :]
    return DrawnMap(x, y, resolution, rows, cols, pixels, _darkest(free), _darkest(occupied) - 1)


def _darkest(threshold: float) -> int:
    """Returns the smallest pixel value whose occupancy, (255 - value) / 255, is below ``threshold``."""
    return next(value for value in range(257) if (255 - value) / 255 < threshold)
