"""Reads a world's map, as a scenario is checked against it before anything runs."""

from pathlib import Path

import numpy as np
import yaml
from PIL import Image, UnidentifiedImageError

from pioneer_demo.scenario.floor import Floor

_WHITE = 255


def floor_from_file(description: Path) -> Floor | None:
    """Returns the floor of a map in map_server's form; None if it cannot be read, which its map_server reports.

    Args:
        description: the map's YAML file, with its image beside it.
    """
    try:
        fields = yaml.safe_load(description.read_text())
        picture = Image.open(description.parent / fields["image"]).convert("L")
        x, y, _ = map(float, fields["origin"])
        free, occupied = float(fields["free_thresh"]), float(fields["occupied_thresh"])
        resolution = float(fields["resolution"])
        negative = bool(fields.get("negate", 0))
    except (OSError, UnidentifiedImageError, yaml.YAMLError, KeyError, TypeError, ValueError):
        return None
    # A table of all shades: maps have up to 16 million cells.
    shades = np.arange(_WHITE + 1) / _WHITE
    chances = shades if negative else 1.0 - shades
    # Row 0 of the image is at the largest y.
    cells = np.asarray(picture)[::-1]
    return Floor(resolution, x, y, (chances < free)[cells], (chances > occupied)[cells])
