"""Third-party Gazebo worlds load unchanged: faulty parts are reported, and only invalid ones are left out."""

from pathlib import Path

import numpy as np
import pytest

from pioneer_gazebo.commands import world_to_map
from pioneer_gazebo.commands.raster import FREE, OCCUPIED
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Box, Mesh, World
from pioneer_gazebo.world.resource import file_of_uri
from pioneer_gazebo.world.sdf import world_from_sdf

SHELF = """<link name='l'>{inertial}<collision name='c'><geometry><box><size>{size}</size></box></geometry></collision>
</link>"""
FLOOR = "<include><uri>model://ground_plane</uri></include>"


def shelf(size: str = "1 1 1", inertial: str = "") -> str:
    return SHELF.format(size=size, inertial=inertial)


def write(folder: Path, inner: str, head: str = "<?xml version='1.0'?>\n") -> Path:
    path = folder / "w.world"
    path.write_text(f"{head}<sdf version='1.6'><world name='w'>{inner}</world></sdf>")
    return path


def write_model(folder: Path, name: str, inner: str, config: str = "<name>m</name>") -> None:
    (folder / name).mkdir(parents=True)
    text = f"<?xml version='1.0'?>\n<model>{config}<sdf version='1.6'>model.sdf</sdf></model>"
    (folder / name / "model.config").write_text(text)
    (folder / name / "model.sdf").write_text(
        f"<sdf version='1.6'><model name='{name}'>{inner}</model></sdf>"
    )


def load(folder: Path, inner: str, **options: str) -> World:
    return world_from_sdf(write(folder, inner, **options), [folder / "models"])


def test_a_model_that_includes_a_static_one_is_static(tmp_path: Path) -> None:
    write_model(
        tmp_path / "models", "shelf", f"<static>true</static><pose>0 0 5 0 0 0</pose>{shelf()}"
    )
    world = load(
        tmp_path,
        "<model name='outer'><include><uri>model://shelf</uri><pose>1 2 0 0 0 0</pose></include></model>",
    )
    (found,) = world.collisions(static_only=True)
    assert found.pose.position == (1, 2, 0)


@pytest.mark.parametrize("static", ["true", "false"])
def test_zero_mass_and_inertia_are_noted_with_file_and_line(tmp_path: Path, static: str) -> None:
    zero = "<inertial>\n<mass>0</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial>"
    world = load(
        tmp_path, f"{FLOOR}<model name='m'><static>{static}</static>{shelf(inertial=zero)}</model>"
    )
    link = world.models[1].links[0]
    assert link.mass > 0
    assert link.inertia.izz > 0
    assert [f"{tmp_path}/w.world, line 3: " in line for line in world.warnings] == [True, True]


def test_a_bare_ampersand_in_a_model_config_is_noted(tmp_path: Path) -> None:
    write_model(tmp_path / "models", "shelf", shelf(), config="<name>Black & White</name>")
    world = load(tmp_path, f"{FLOOR}<include><uri>model://shelf</uri></include>")
    assert [model.name for model in world.models] == ["ground_plane", "shelf"]
    assert "model.config: not well-formed XML" in world.warnings[0]


def test_an_xml_declaration_after_blank_lines_is_noted(tmp_path: Path) -> None:
    world = load(tmp_path, FLOOR, head="\n\n<?xml version='1.0' encoding='utf-8'?>\n")
    assert len(world.models) == 1
    assert "not well-formed XML" in world.warnings[0]


def test_only_the_invalid_shape_joint_or_model_of_a_world_is_left_out(tmp_path: Path) -> None:
    second = (
        SHELF.format(size="2 2 2", inertial="")
        .replace("'c'", "'d'")
        .replace("<link name='l'>", "")
        .replace("</link>", "")
    )
    broken = shelf("0 1 1").replace("</link>", f"{second}</link>")
    joint = (
        "<joint name='j' type='revolute'><parent>l</parent><child>nowhere</child><axis/></joint>"
    )
    world = load(
        tmp_path,
        f"{FLOOR}<model name='a'>{broken}{joint}</model><model name='b'><pose>1 2 x 0 0 0</pose>{shelf()}</model>"
        f"<model name='c'>{shelf()}</model>",
    )
    assert [model.name for model in world.models] == ["ground_plane", "a", "c"]
    assert [one.shape for one in world.models[1].links[0].collisions] == [Box((2, 2, 2))]
    assert len(world.warnings) == 3, world.warnings
    assert all(
        line.startswith(f"{tmp_path}/w.world, line ") and "; it is ignored" in line
        for line in world.warnings
    )


def test_a_world_in_which_everything_falls_or_nothing_can_be_touched_is_noted(
    tmp_path: Path,
) -> None:
    assert "all models fall" in load(tmp_path, f"<model name='m'>{shelf()}</model>").warnings[0]
    assert (
        "no model has a collision shape"
        in load(tmp_path, "<model name='m'><link name='l'/></model>").warnings[0]
    )
    assert load(tmp_path, FLOOR).warnings == ()


@pytest.mark.parametrize(
    ("uri", "place"),
    [
        ("file://meshes/a.obj", "world/meshes/a.obj"),
        ("meshes/a.obj", "world/meshes/a.obj"),
        ("file://models/shelf/a.obj", "models/shelf/a.obj"),
        ("file://media/a.obj", "resources/media/a.obj"),
        ("model://shelf/a%20b.obj", "models/shelf/a b.obj"),
        ("model://beside/a.obj", "beside/a.obj"),
    ],
)
def test_relative_uris_are_found_as_gazebo_finds_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, uri: str, place: str
) -> None:
    path = tmp_path / place
    path.parent.mkdir(parents=True)
    path.write_text("")
    monkeypatch.setenv("GAZEBO_RESOURCE_PATH", str(tmp_path / "resources"))
    assert file_of_uri(uri, tmp_path / "world", [tmp_path / "models"]) == path


def test_the_map_of_a_world_shows_boxes_that_are_not_static_unless_asked_not_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, f"{FLOOR}<model name='crate'>{shelf()}</model>")
    for words, grey in (([], OCCUPIED), (["--static-only"], FREE)):
        assert (
            world_to_map.main(
                [str(path), "--extent", "-2", "-2", "4", "4", "--outside", "free", *words]
            )
            == 0
        )
        assert "1 models that can move (crate …)" in capsys.readouterr().err
        cells = np.frombuffer((tmp_path / "w.pgm").read_bytes()[-80 * 80 :], np.uint8).reshape(
            80, 80
        )
        assert cells[40, 40] == grey


def test_a_mesh_on_its_side_in_collada_stands_as_in_gazebo(tmp_path: Path) -> None:
    text = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset><unit meter="0.01"/>
    <up_axis>Y_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p">
    <float_array id="a" count="9">0 0 0 100 0 0 0 0 200</float_array></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry>
    </library_geometries><library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node>
    </visual_scene></library_visual_scenes></COLLADA>"""
    (tmp_path / "wall.dae").write_text(text)
    mesh = "<geometry><mesh><uri>wall.dae</uri></mesh></geometry>"
    inner = f"<model name='m'><static>1</static><link name='l'><collision name='c'>{mesh}</collision></link></model>"
    (found,) = load(tmp_path, inner).collisions()
    assert isinstance(found.collision.shape, Mesh)
    np.testing.assert_allclose(triangles_of_mesh(found.collision.shape).max(axis=(0, 1)), (1, 0, 2))


CRATE = """<model name='{0}'>{1}<link name='link'><inertial><mass>1</mass></inertial>{2}
<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision></link></model>"""
MISSING = "<include><uri>model://a_model_that_nobody_has</uri></include>"
FLAT = """<collision name='flat'><geometry><mesh><uri>flat.obj</uri><scale>1 0 0</scale></mesh>
</geometry></collision>"""
LOST = "<state world_name='w'><model name='a'><pose>0 0 -2e6 0 0 0</pose></model></state>"
HUGE = CRATE.replace("1 1 1", "1e9 1 1")


@pytest.mark.parametrize(
    ("content", "models", "warning"),
    [
        (CRATE.format("a", MISSING, ""), ["a"], "a_model_that_nobody_has is not found"),
        (f"<model name='hollow'>{MISSING}</model>", [], "the model has no links and is left out"),
        ("<model name='hollow'/>", [], "the model has no links and is left out"),
        (CRATE.format("a", "", FLAT), ["a"], "must not be 0, not '1 0 0'"),
        (CRATE.format("a", "<static>1</static>", FLAT), ["a"], "must not be 0, not '1 0 0'"),
        (CRATE.format("a", "", "") + LOST, [], "position must be finite"),
        (CRATE.format("a", "<static>1</static>", "") + LOST, [], "position must be finite"),
        (HUGE.format("a", "<static>1</static>", ""), [], "size of collision c must be"),
        (HUGE.format("a", "", ""), [], "size of collision c must be"),
        (
            CRATE.format("a", "<model name='b'><link name='l'><pose>1 2</pose></link></model>", ""),
            ["a"],
            "<pose>",
        ),
    ],
)
def test_a_detail_of_a_world_costs_the_smallest_thing_around_it(
    tmp_path: Path, content: str, models: list[str], warning: str
) -> None:
    """Everything else of the world is loaded, and a line says what is left out."""
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    file = tmp_path / "w.world"
    other = CRATE.format("other", "<pose>5 5 0.5 0 0 0</pose>", "")
    file.write_text(
        f"<!-- saved --><?xml version='1.0'?>"
        f"<sdf version='1.6'><world name='w'>{FLOOR}{content}{other}</world></sdf>"
    )
    world = world_from_sdf(file, [])
    engine = BulletEngine(Physics())
    simulation = Simulation(engine, triangles_of_mesh, Physics())
    refused = simulation.load(world)
    assert set(simulation.names()) == {"ground_plane", "other", *models}
    assert any(warning in line for line in (*world.warnings, *refused)), (world.warnings, refused)
    simulation.advance(120)
    engine.close()
