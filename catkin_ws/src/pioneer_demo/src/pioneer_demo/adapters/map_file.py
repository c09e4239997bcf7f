"""Maps as ``map_server`` reads them: a YAML file and an image."""

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from pioneer_demo.core.error import MapFileError
from pioneer_demo.core.floor import Floor


def floor_from_file(path: Path) -> Floor:
    """Returns the floor of the map whose YAML file is ``path``: free, occupied or unknown by the file's thresholds.

    Raises:
        MapFileError: the file or its image is missing, or lacks a field, or the map is turned.
    """
    try:
        fields = yaml.safe_load(path.read_text())
        # Maps of 200 × 200 m are images of 16 million pixels, which PIL would take for an attack.
        with Image.open(path.parent / fields["image"]) as image:
            pixels = np.asarray(image.convert("L"), dtype=np.float32)
        x, y, yaw = (float(value) for value in fields["origin"])
        resolution = float(fields["resolution"])
        shade = pixels / 255.0 if int(fields.get("negate", 0)) else 1.0 - pixels / 255.0
        free, occupied = shade < float(fields["free_thresh"]), shade > float(fields["occupied_thresh"])
    except (OSError, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise MapFileError(f"cannot read the map {path}: {error}") from error
    if yaw:
        raise MapFileError(f"the map {path} is turned by {yaw:g} rad; the demo needs one that is not")
    return Floor(resolution, x, y, free[::-1], occupied[::-1])
