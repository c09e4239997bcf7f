"""Reads triangles of Collada (.dae) meshes: geometry and node transforms; ignores materials, skins and animations."""

import itertools
import math

import numpy as np
from lxml import etree
from numpy.typing import NDArray

Triangles = NDArray[np.float64]


def triangles_from_collada(data: bytes) -> Triangles:
    """Returns all triangles of the scene in metres, shape (n, 3, 3), in the document's axes.

    ``<up_axis>`` is ignored, as in Gazebo classic; models are designed to stand upright without it.

    Raises:
        ValueError: the document is malformed or contains no triangles.
    """
    try:
        root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))
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
            parts.append(points[_corner_indices(primitive, kind, stride, int(vertex.get("offset", "0")))])
    return np.concatenate(parts)


def _corner_indices(primitive: etree._Element, kind: str, stride: int, offset: int) -> NDArray[np.intp]:
    """Returns vertex indices, shape (n, 3); polygons are split into triangle fans."""
    rows = [_numbers(p.text).astype(np.intp).reshape(-1, stride)[:, offset] for p in primitive.iterfind("{*}p")]
    if kind == "triangles":
        return np.concatenate([*rows, np.empty(0, dtype=np.intp)]).reshape(-1, 3)
    if kind == "polylist":
        counts = _numbers(primitive.findtext("{*}vcount")).astype(np.intp)
        rows = np.split(np.concatenate(rows), np.cumsum(counts)[:-1])
    fans = [(row[0], b, c) for row in rows for b, c in itertools.pairwise(row[1:])]
    return np.array(fans, dtype=np.intp).reshape(-1, 3)
