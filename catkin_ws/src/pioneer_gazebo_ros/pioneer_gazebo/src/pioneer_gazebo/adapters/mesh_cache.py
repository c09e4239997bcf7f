"""Caches meshes that are slow to read as arrays on disk, named by a hash of their content."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pioneer_gazebo.core.facet import Triangles

SLOW = 200_000
"""Smaller files [bytes] are read in less than 0.1 s and are not cached."""

FORMAT = "1"
"""Cache format version; increment when a reader's result changes for the same file."""


def cache_folder() -> Path:
    """Returns the mesh cache folder, below XDG_CACHE_HOME or ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pioneer_gazebo" / "mesh"


def cached(data: bytes, kind: str, reader: Callable[[bytes], Triangles]) -> Triangles:
    """Returns ``reader(data)``, from the cache if present.

    A cache that cannot be read or written is ignored.
    """
    if len(data) < SLOW:
        return reader(data)
    path = cache_folder() / f"{hashlib.sha256(FORMAT.encode() + kind.encode() + data).hexdigest()}.npy"
    try:
        found = np.load(path, allow_pickle=False)
        if found.dtype == np.float64 and found.ndim == 3 and found.shape[1:] == (3, 3):
            return found
    except (OSError, ValueError, EOFError):
        pass  # not cached yet, or incomplete: written below
    made = reader(data)
    _write(path, made)
    return made


def _write(path: Path, triangles: Triangles) -> None:
    """Writes a cache file atomically."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            np.save(file, triangles, allow_pickle=False)
        os.replace(file.name, path)
    except OSError:
        return  # read-only or full disk: the mesh is read again next time
