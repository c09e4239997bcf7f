"""Reads triangle meshes: STL (binary and text), Wavefront OBJ, and the triangles of Collada.

Parsed and reduced meshes are cached in memory; files that are slow to read also on disk, keyed by content.
"""

import functools
import hashlib
import itertools
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from pioneer_gazebo.adapters.collada import triangles_from_collada
from pioneer_gazebo.adapters.resource import content_of
from pioneer_gazebo.core.error import DescriptionError
from pioneer_gazebo.core.facet import Points, Triangles, hull_points, reduced
from pioneer_gazebo.core.world import Link, Mesh

MESHES_KEPT = 256

LARGE = 4 << 20
"""Files of more bytes are slow enough to read that this is reported."""

_BINARY_HEADER = 84
_BINARY_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def triangles_of_mesh(mesh: Mesh) -> Triangles:
    """Returns the mesh's triangles, scaled, in the mesh's frame: shape (n, 3, 3), float64 [m].

    Raises:
        DescriptionError: the file cannot be read, is too large, malformed, or of an unknown format.
    """
    return _read(mesh.path, version(mesh.path)) * np.asarray(mesh.scale)


def solid_of_mesh(mesh: Mesh) -> Triangles:
    """Returns the mesh's triangles, reduced to a number that a physics engine can handle.

    Raises:
        DescriptionError: see `triangles_of_mesh`.
    """
    return _reduced(mesh.path, version(mesh.path)) * np.asarray(mesh.scale)


def hull_of_mesh(mesh: Mesh) -> Points:
    """Returns the vertices of the mesh's convex hull, shape (n, 3), reduced to what a physics engine can handle.

    Raises:
        DescriptionError: see `triangles_of_mesh`.
    """
    return _hull(mesh.path, version(mesh.path)) * np.asarray(mesh.scale)


def prepare(links: Iterable[Link], static: bool, report: Callable[[str], None]) -> None:
    """Reads and reduces the meshes of links in advance, so that spawning them takes no time.

    Thread-safe.

    Args:
        links: of one model.
        static: whether the model is static.
        report: called before a mesh that is slow to read.

    Raises:
        DescriptionError: see `triangles_of_mesh`.
    """
    for shape in {one.shape for link in links for one in link.collisions if isinstance(one.shape, Mesh)}:
        size = version(shape.path)[1]
        if size > LARGE:
            report(f"reading mesh {shape.path} ({size >> 20} MiB) …")
        (solid_of_mesh if static else hull_of_mesh)(shape)


@functools.lru_cache(maxsize=MESHES_KEPT)
def _reduced(path: str, version: tuple[int, int]) -> Triangles:
    return reduced(_read(path, version))


@functools.lru_cache(maxsize=MESHES_KEPT)
def _hull(path: str, version: tuple[int, int]) -> Points:
    return hull_points(_read(path, version))


def version(path: str) -> tuple[int, int]:
    """Returns a file's modification time [ns] and size, used in the keys of everything cached from it.

    Raises:
        DescriptionError: the file cannot be read.
    """
    try:
        status = os.stat(path)
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}") from None
    return status.st_mtime_ns, status.st_size


@functools.lru_cache(maxsize=MESHES_KEPT)
def _read(path: str, version: tuple[int, int]) -> Triangles:
    del version
    readers = {".stl": _from_stl, ".obj": _from_obj, ".dae": triangles_from_collada}
    reader = readers.get(Path(path).suffix.lower())
    if reader is None:
        raise DescriptionError(f"{path}: meshes are read from {', '.join(sorted(readers))} files")
    data = content_of(path)
    try:
        triangles = cached(data, Path(path).suffix.lower(), reader)
    except (ValueError, IndexError, KeyError) as error:
        raise DescriptionError(f"{path}: is broken: {error}") from None
    if not len(triangles):
        raise DescriptionError(f"{path}: is broken: it has no triangles")
    if not np.isfinite(triangles).all():
        raise DescriptionError(f"{path}: is broken: a corner is not a finite number")
    triangles.setflags(write=False)
    return triangles


def _from_stl(data: bytes) -> Triangles:
    """Reads STL. A binary file's length follows from its triangle count; any other length means text."""
    if len(data) >= _BINARY_HEADER:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == _BINARY_HEADER + count * _BINARY_TRIANGLE.itemsize:
            table = np.frombuffer(data, _BINARY_TRIANGLE, count, _BINARY_HEADER)
            return table["corners"].astype(np.float64)
    words = data.decode("ascii", "replace").split()
    if not words or words[0] != "solid":
        raise ValueError("neither binary nor text STL")
    corners = [[float(w) for w in words[i + 1 : i + 4]] for i, word in enumerate(words) if word == "vertex"]
    return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)


def _from_obj(data: bytes) -> Triangles:
    """Reads OBJ vertices and faces, splitting polygons into triangle fans; ignores everything else."""
    corners: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            corners.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            indices = [_obj_index(word, len(corners)) for word in words[1:]]
            faces += [(indices[0], b, c) for b, c in itertools.pairwise(indices[1:])]
    points = np.array(corners, dtype=np.float64).reshape(-1, 3)
    return points[np.array(faces, dtype=np.intp).reshape(-1, 3)]


def _obj_index(word: str, count: int) -> int:
    index = int(word.partition("/")[0])
    index = index - 1 if index > 0 else count + index
    if not 0 <= index < count:
        raise ValueError(f"a face names corner {word} of {count}")
    return index


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
