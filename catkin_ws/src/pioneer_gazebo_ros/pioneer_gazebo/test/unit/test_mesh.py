import struct

import numpy as np
import pytest

from pioneer_gazebo.adapters.mesh import triangles_of_mesh
from pioneer_gazebo.core.error import DescriptionError
from pioneer_gazebo.core.world import Mesh

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
    data = b"solid".ljust(80) + struct.pack("<I", 1) + struct.pack("<12fH", 0, 0, 1, *TRIANGLE.ravel(), 0)
    np.testing.assert_allclose(read(tmp_path, "b.stl", data), TRIANGLE)


def test_obj_with_a_square_is_two_triangles(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3/3 -1\n"
    found = read(tmp_path, "q.obj", text)
    np.testing.assert_allclose(found[1], [(0, 0, 0), (1, 1, 0), (0, 1, 0)])
    assert len(found) == 2


def test_collada_is_in_metres_with_z_up(tmp_path):
    np.testing.assert_allclose(read(tmp_path, "z.dae", DAE.format(up="Z_UP"))[0][2], (0.5, 0.5, 1.0))
    np.testing.assert_allclose(read(tmp_path, "y.dae", DAE.format(up="Y_UP"))[0][2], (0.5, -1.0, 0.5))


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
