import os
import struct

import numpy as np
import pytest

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.mesh import hull_of_mesh, solid_of_mesh, triangles_of_mesh
from pioneer_gazebo.world.model import Mesh

TRIANGLE = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 2)]], dtype=float)
DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.5"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="9">0 0 0 1 0 0 0 1 2</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<p>0 0 1 0 2 0</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>1 0 0</translate><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes></COLLADA>"""


def read(tmp_path, name, content, scale=(1.0, 1.0, 1.0)):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return triangles_of_mesh(Mesh(str(path), scale))


def test_text_stl_is_read_and_scaled(tmp_path):
    corners = "".join(f"vertex {x} {y} {z}\n" for x, y, z in TRIANGLE[0])
    text = f"solid s\nfacet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\nendsolid s\n"
    np.testing.assert_allclose(read(tmp_path, "t.stl", text, (2.0, 1.0, 1.0)), TRIANGLE * (2, 1, 1))


def test_binary_stl_is_read_even_when_its_header_says_solid(tmp_path):
    data = (
        b"solid".ljust(80)
        + struct.pack("<I", 1)
        + struct.pack("<12fH", 0, 0, 1, *TRIANGLE.ravel(), 0)
    )
    np.testing.assert_allclose(read(tmp_path, "b.stl", data), TRIANGLE)


def test_obj_with_a_square_is_two_triangles(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3/3 -1\n"
    found = read(tmp_path, "q.obj", text)
    np.testing.assert_allclose(found[1], [(0, 0, 0), (1, 1, 0), (0, 1, 0)])
    assert len(found) == 2


def test_collada_is_in_metres_and_its_up_axis_changes_nothing_as_in_gazebo(tmp_path):
    for up in ("X_UP", "Y_UP", "Z_UP"):
        found = read(tmp_path, f"{up}.dae", DAE.format(up=up))
        np.testing.assert_allclose(found, (TRIANGLE + np.array([1, 0, 0])) * 0.5, atol=1e-12)


def test_collada_node_transforms_apply_in_order_and_through_parents(tmp_path):
    inner = "<translate>1 0 0</translate><instance_geometry"
    moves = "<translate>0 0 1</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale><instance_geometry"
    outer = DAE.format(up="Y_UP").replace(inner, f"<translate>5 0 0</translate><node>{moves}")
    found = read(tmp_path, "n.dae", outer.replace("</node>", "</node></node>"))
    x, y, z = TRIANGLE[0].T * 2
    np.testing.assert_allclose(found[0], np.column_stack([5 - y, x, z + 1]) * 0.5, atol=1e-12)


def ball(count):
    """Returns the triangles of a ball of radius 1 around the origin."""
    rows, cols = count, 2 * count
    v, u = np.meshgrid(
        np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, cols + 1), indexing="ij"
    )
    p = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1)
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    return np.concatenate(
        [
            np.stack([a, b, c], axis=2).reshape(-1, 3, 3),
            np.stack([a, c, d], axis=2).reshape(-1, 3, 3),
        ]
    )


def stl(triangles):
    table = np.zeros(
        len(triangles),
        dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")],
    )
    table["corners"] = triangles
    return bytes(80) + struct.pack("<I", len(triangles)) + table.tobytes()


def test_a_mesh_of_300_000_triangles_is_made_small_and_keeps_its_shape(tmp_path):
    path = tmp_path / "ball.stl"
    path.write_bytes(stl(ball(280)))
    mesh = Mesh(str(path), (2.0, 2.0, 2.0))
    assert len(triangles_of_mesh(mesh)) > 300_000
    solid, hull = solid_of_mesh(mesh), hull_of_mesh(mesh)
    assert len(solid) <= 20_000
    assert np.abs(np.linalg.norm(solid.reshape(-1, 3), axis=1) - 2.0).max() < 0.001
    assert np.abs(np.sort(np.linalg.norm(solid.mean(axis=1), axis=1))[:10] - 2.0).max() < 0.02
    assert len(hull) <= 64
    np.testing.assert_allclose(
        [hull.min(axis=0), hull.max(axis=0)], [[-2] * 3, [2] * 3], atol=0.001
    )
    ways = np.random.default_rng(0).normal(size=(500, 3))
    reach = (hull @ (ways / np.linalg.norm(ways, axis=1, keepdims=True)).T).max(axis=0)
    assert reach.min() > 0.9 * 2, "the hull of a ball is round on all sides"


def test_a_large_mesh_is_read_once_and_then_comes_from_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "ball.stl"
    path.write_bytes(stl(ball(50)))
    first = triangles_of_mesh(Mesh(str(path)))
    [kept] = (tmp_path / "cache").rglob("*.npy")
    copy = tmp_path / "copy.stl"
    copy.write_bytes(path.read_bytes())
    kept.write_bytes(b"broken")
    np.testing.assert_array_equal(triangles_of_mesh(Mesh(str(copy))), first)
    np.save(kept, first + 1.0)
    third = tmp_path / "third.stl"
    third.write_bytes(path.read_bytes())
    np.testing.assert_array_equal(triangles_of_mesh(Mesh(str(third))), first + 1.0)


def test_pipes_devices_folders_and_huge_files_are_no_meshes(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    (tmp_path / "folder.stl").mkdir()
    with (tmp_path / "huge.stl").open("wb") as file:
        file.truncate(300 << 20)
    for name, message in (
        ("pipe.stl", "not a regular file"), ("zero.stl", "not a regular file"), ("folder.stl", "Is a directory"),
        ("huge.stl", "300 MiB exceed the limit of 256"),
    ):  # fmt: skip
        with pytest.raises(DescriptionError, match=message):
            triangles_of_mesh(Mesh(str(tmp_path / name)))
    with pytest.raises(DescriptionError, match=r"meshes are read from \.dae, \.obj, \.stl"):
        triangles_of_mesh(Mesh("/dev/zero"))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.stl", b"\x00" * 10, "neither binary nor text"),
        ("x.obj", "v 0 0 0\nf 1 2 3\n", "corner 2 of 1"),
        ("x.obj", "v 0 0 nan\nf 1 1 1\n", "not a finite number"),
        ("x.dae", "<COLLADA", "not well-formed"),
        ("x.ply", "ply", "read from .dae, .obj, .stl files"),
    ],
)
def test_broken_mesh_is_refused_by_name(tmp_path, name, content, message):
    with pytest.raises(DescriptionError, match=message):
        read(tmp_path, name, content)


def test_missing_mesh_is_refused_by_name(tmp_path):
    with pytest.raises(DescriptionError, match=r"none\.stl: cannot be read"):
        triangles_of_mesh(Mesh(str(tmp_path / "none.stl")))
