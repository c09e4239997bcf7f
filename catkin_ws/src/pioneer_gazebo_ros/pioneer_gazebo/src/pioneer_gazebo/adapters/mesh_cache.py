"""Meshes that take long to read are kept as arrays in a cache folder, named by a hash of their content."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pioneer_gazebo.core.facet import Triangles

SLOW = 200_000
"""A file with fewer bytes is read in less than a tenth of a second, and not kept."""

FORMAT = "1"
"""Changes when readers return something else for the same file."""


def cache_folder() -> Path:
    """Returns where meshes are kept: below XDG_CACHE_HOME, else ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pioneer_gazebo" / "mesh"


def cached(data: bytes, kind: str, reader: Callable[[bytes], Triangles]) -> Triangles:
    """Returns what ``reader`` makes of a file's content, from the cache folder where that has it.

    A cache that cannot be read or written is done without.
    """
    if len(data) < SLOW:
        return reader(data)
    path = cache_folder() / f"{hashlib.sha256(FORMAT.encode() + kind.encode() + data).hexdigest()}.npy"
    try:
        found = np.load(path, allow_pickle=False)
        if found.dtype == np.float64 and found.ndim == 3 and found.shape[1:] == (3, 3):
            return found
    except (OSError, ValueError, EOFError):
        pass  # not there yet, or not whole: it is made and written below
    made = reader(data)
    _write(path, made)
    return made


def _write(path: Path, triangles: Triangles) -> None:
    """Writes a file that others see whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            np.save(file, triangles, allow_pickle=False)
        os.replace(file.name, path)
    except OSError:
        return  # a read-only or full disk: the mesh is read again next time
