"""Reads triangle meshes: STL (binary and text), Wavefront OBJ, and the triangles of Collada."""

import functools
import itertools
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.adapters.collada import triangles_from_collada
from pioneer_gazebo.core.error import DescriptionError
from pioneer_gazebo.core.world import Mesh

Triangles = NDArray[np.float64]

_BINARY_HEADER = 84
_BINARY_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def triangles_of_mesh(mesh: Mesh) -> Triangles:
    """Returns the mesh's triangles, scaled, in the mesh's frame: shape (n, 3, 3), float64 [m].

    Raises:
        DescriptionError: the file cannot be read, is of another format, or is broken.
    """
    modified = 0
    try:
        modified = os.stat(mesh.path).st_mtime_ns
    except OSError as error:
        raise DescriptionError(f"{mesh.path}: cannot be read: {error.strerror}") from None
    return _read(mesh.path, modified) * np.asarray(mesh.scale)


@functools.lru_cache(maxsize=32)
def _read(path: str, modified: int) -> Triangles:
    del modified  # part of the cache's key: a changed file is read again
    data = Path(path).read_bytes()
    readers = {".stl": _from_stl, ".obj": _from_obj, ".dae": triangles_from_collada}
    reader = readers.get(Path(path).suffix.lower())
    if reader is None:
        raise DescriptionError(f"{path}: meshes are read from {', '.join(sorted(readers))} files")
    try:
        triangles = reader(data)
    except (ValueError, IndexError, KeyError) as error:
        raise DescriptionError(f"{path}: is broken: {error}") from None
    if not np.isfinite(triangles).all():
        raise DescriptionError(f"{path}: is broken: a corner is not a finite number")
    triangles.setflags(write=False)
    return triangles


def _from_stl(data: bytes) -> Triangles:
    """A binary file's length follows from its count; whatever has another length must be text."""
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
    """Faces with more than three corners are cut into fans; everything but corners and faces is left out."""
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
