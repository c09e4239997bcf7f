"""Reads triangle meshes: STL (binary and text), Wavefront OBJ, and the triangles of Collada.

Parsed and reduced meshes are cached in memory; files that are slow to read also on disk, keyed by content.
"""

import functools
import hashlib
import itertools
import math
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.facet import Points, Triangles, hull_points, reduced
from pioneer_gazebo.world.model import Link, Mesh
from pioneer_gazebo.world.resource import content_of

MESHES_KEPT = 256

LARGE = 4 << 20
"""Files of more bytes are slow enough to read that this is reported."""

_BINARY_HEADER = 84
_BINARY_TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)


def triangles_of_mesh(mesh: Mesh) -> Triangles:
    """Returns the mesh's triangles, scaled, in the mesh's frame: shape (n, 3, 3), float64 [m].

    Raises:
        DescriptionError: the file cannot be read, is too large, malformed, or of an unknown format.
    """
    return _triangles(mesh) * np.asarray(mesh.scale)


def solid_of_mesh(mesh: Mesh) -> Triangles:
    """Returns the mesh's triangles, reduced to a number that a physics engine can handle.

    Raises:
        DescriptionError: see `triangles_of_mesh`.
    """
    if mesh.corners:
        return reduced(_triangles(mesh)) * np.asarray(mesh.scale)
    return _made(reduced, mesh.path, version(mesh.path)) * np.asarray(mesh.scale)


def hull_of_mesh(mesh: Mesh) -> Points:
    """Returns the vertices of the mesh's convex hull, shape (n, 3), reduced to what a physics engine can handle.

    Raises:
        DescriptionError: see `triangles_of_mesh`.
    """
    if mesh.corners:
        return hull_points(_triangles(mesh)) * np.asarray(mesh.scale)
    return _made(hull_points, mesh.path, version(mesh.path)) * np.asarray(mesh.scale)


def _triangles(mesh: Mesh) -> Triangles:
    """Returns a mesh's triangles without its scale."""
    if mesh.corners:
        return np.array(mesh.corners).reshape(-1, 3, 3)
    return _read(mesh.path, version(mesh.path))


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
    for shape in {
        one.shape
        for link in links
        for one in link.collisions
        if isinstance(one.shape, Mesh) and one.shape.path
    }:
        size = version(shape.path)[1]
        if size > LARGE:
            report(f"reading mesh {shape.path} ({size >> 20} MiB) …")
        (solid_of_mesh if static else hull_of_mesh)(shape)


@functools.lru_cache(maxsize=2 * MESHES_KEPT)
def _made(make: Callable[[Triangles], Points], path: str, version: tuple[int, int]) -> Points:
    return make(_read(path, version))


def version(path: str) -> tuple[int, int]:
    """Returns a file's modification time [ns] and size, used in the keys of everything cached from it; 0 for no file.

    Raises:
        DescriptionError: the file cannot be read.
    """
    if not path:
        return 0, 0
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
    corners = [
        [float(w) for w in words[i + 1 : i + 4]] for i, word in enumerate(words) if word == "vertex"
    ]
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


def cached(data: bytes, kind: str, reader: Callable[[bytes], Triangles]) -> Triangles:
    """Returns ``reader(data)``, from the cache below XDG_CACHE_HOME or ~/.cache if present.

    A cache that cannot be read or written is ignored.
    """
    if len(data) < SLOW:
        return reader(data)
    folder = (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pioneer_gazebo" / "mesh"
    )
    path = folder / f"{hashlib.sha256(FORMAT.encode() + kind.encode() + data).hexdigest()}.npy"
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


def triangles_from_collada(data: bytes) -> Triangles:
    """Returns all triangles of the scene in metres, shape (n, 3, 3), in the document's axes.

    ``<up_axis>`` is ignored, as in Gazebo classic; models are designed to stand upright without it.

    Raises:
        ValueError: the document is malformed or contains no triangles.
    """
    try:
        root = etree.fromstring(
            data, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
        )
    except etree.XMLSyntaxError as error:
        raise ValueError(f"not well-formed XML: {error.msg}") from None
    geometries = {node.get("id"): _geometry(node) for node in root.iterfind(".//{*}geometry")}
    nodes = {node.get("id"): node for node in root.iterfind(".//{*}node") if node.get("id")}
    parts: list[Triangles] = []
    for scene in root.iterfind(".//{*}visual_scene"):
        for node in scene.iterfind("{*}node"):
            _collect(node, np.eye(4), geometries, nodes, parts, ())
    if not parts:
        raise ValueError("the scene holds no triangles")
    unit = root.find("{*}asset/{*}unit")
    scale = float(unit.get("meter", "1")) if unit is not None else 1.0
    return np.concatenate(parts) * scale


def _numbers(text: str | None) -> NDArray[np.float64]:
    return np.array((text or "").split(), dtype=np.float64)


def _collect(
    node: etree._Element,
    above: NDArray[np.float64],
    geometries: dict[str, Triangles],
    nodes: dict[str, etree._Element],
    parts: list[Triangles],
    seen: tuple[str, ...],
) -> None:
    matrix = above @ _transform(node)
    for instance in node.iterfind("{*}instance_geometry"):
        triangles = geometries[(instance.get("url") or "").removeprefix("#")]
        parts.append(triangles @ matrix[:3, :3].T + matrix[:3, 3])
    for child in node.iterfind("{*}node"):
        _collect(child, matrix, geometries, nodes, parts, seen)
    for instance in node.iterfind("{*}instance_node"):
        name = (instance.get("url") or "").removeprefix("#")
        if name in seen:
            raise ValueError(f"node {name} holds itself")
        _collect(nodes[name], matrix, geometries, nodes, parts, (*seen, name))


def _transform(node: etree._Element) -> NDArray[np.float64]:
    matrix = np.eye(4)
    for child in node.iterchildren(tag=etree.Element):
        kind = etree.QName(child).localname
        if kind == "matrix":
            matrix = matrix @ _numbers(child.text).reshape(4, 4)
        elif kind == "translate":
            step = np.eye(4)
            step[:3, 3] = _numbers(child.text)
            matrix = matrix @ step
        elif kind == "scale":
            matrix = matrix @ np.diag([*_numbers(child.text), 1.0])
        elif kind == "rotate":
            matrix = matrix @ _rotation(_numbers(child.text))
    return matrix


def _rotation(axis_angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the matrix of a rotation by Rodrigues' formula; the angle is in degrees."""
    x, y, z = axis_angle[:3] / np.linalg.norm(axis_angle[:3])
    angle = math.radians(float(axis_angle[3]))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result = np.eye(4)
    result[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return result


def _geometry(node: etree._Element) -> Triangles:
    sources = {source.get("id"): source for source in node.iterfind(".//{*}source")}
    positions = {
        vertices.get("id"): (source.get("source") or "").removeprefix("#")
        for vertices in node.iterfind(".//{*}vertices")
        for source in vertices.iterfind("{*}input[@semantic='POSITION']")
    }
    parts = [np.empty((0, 3, 3))]
    for kind in ("triangles", "polylist", "polygons"):
        for primitive in node.iterfind(f".//{{*}}{kind}"):
            vertex = primitive.find("{*}input[@semantic='VERTEX']")
            if vertex is None:
                raise ValueError(f"<{kind}> has no corners")
            source = sources[positions[(vertex.get("source") or "").removeprefix("#")]]
            points = _numbers(source.findtext("{*}float_array")).reshape(-1, 3)
            stride = 1 + max(int(i.get("offset", "0")) for i in primitive.iterfind("{*}input"))
            parts.append(
                points[_corner_indices(primitive, kind, stride, int(vertex.get("offset", "0")))]
            )
    return np.concatenate(parts)


def _corner_indices(
    primitive: etree._Element, kind: str, stride: int, offset: int
) -> NDArray[np.intp]:
    """Returns vertex indices, shape (n, 3); polygons are split into triangle fans."""
    rows = [
        _numbers(p.text).astype(np.intp).reshape(-1, stride)[:, offset]
        for p in primitive.iterfind("{*}p")
    ]
    if kind == "triangles":
        return np.concatenate([*rows, np.empty(0, dtype=np.intp)]).reshape(-1, 3)
    if kind == "polylist":
        counts = _numbers(primitive.findtext("{*}vcount")).astype(np.intp)
        rows = np.split(np.concatenate(rows), np.cumsum(counts)[:-1])
    fans = [(row[0], b, c) for row in rows for b, c in itertools.pairwise(row[1:])]
    return np.array(fans, dtype=np.intp).reshape(-1, 3)
