import math
import time

import numpy as np
import pytest

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.model import Box, Cylinder, Mesh, Plane, Sphere
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.sdf import world_from_sdf, world_from_sdf_text
from pioneer_gazebo.world.sdf_text import sdf_from_world

BOX = "<collision name='c'><geometry><box><size>1 2 3</size></box></geometry></collision>"


def world(inner, version="1.6", **options):
    text = f"<?xml version='1.0'?><sdf version='{version}'><world name='w'>{inner}</world></sdf>"
    return world_from_sdf_text(text, **options)


def model(inner, name="m"):
    return f"<model name='{name}'>{inner}</model>"


def test_every_kind_of_geometry_is_read():
    shapes = {
        "<box><size>1 2 3</size></box>": Box((1, 2, 3)),
        "<cylinder><radius>0.5</radius><length>2</length></cylinder>": Cylinder(0.5, 2),
        "<sphere><radius>0.25</radius></sphere>": Sphere(0.25),
        "<plane><normal>0 0 2</normal><size>7 8</size></plane>": Plane((0, 0, 1), (7, 8)),
    }
    for text, shape in shapes.items():
        link = f"<link name='l'><collision name='c'><geometry>{text}</geometry></collision></link>"
        (found,) = world(model(f"<static>1</static>{link}")).collisions()
        assert found.collision.shape == shape


def test_nested_poses_are_composed():
    box = BOX.replace("<geometry>", "<pose>0 1 0 0 0 0</pose><geometry>")
    link = f"<link name='l'><pose>1 0 0 0 0 0</pose>{box}</link>"
    (found,) = world(model(f"<pose>10 0 0 0 0 {math.pi / 2}</pose>{link}")).collisions()
    assert found.pose.position == pytest.approx((9, 1, 0))
    assert found.pose.yaw == pytest.approx(math.pi / 2)


def test_static_gravity_friction_and_mass_are_read():
    surface = "<surface><friction><ode><mu>0.3</mu></ode></friction></surface>"
    inertial = (
        "<inertial><mass>4</mass><inertia><ixx>1</ixx><iyy>2</iyy><izz>3</izz></inertia></inertial>"
    )
    link = (
        f"<link name='l'>{inertial}{BOX.replace('</collision>', surface + '</collision>')}</link>"
    )
    loaded = world("<gravity>0 0 -1.6</gravity>" + model(f"<static>1</static>{link}"))
    (found,) = loaded.collisions()
    assert loaded.gravity == (0, 0, -1.6)
    assert found.model.static
    assert found.collision.friction == 0.3
    assert (found.link.mass, found.link.inertia.izz) == (4, 3)


def test_gravity_of_sdf_1_4_stands_in_physics():
    assert world(
        "<physics type='ode'><gravity>0 0 -3</gravity></physics>", version="1.4"
    ).gravity == (0, 0, -3)


def test_ground_plane_and_sun_are_known_without_a_model_path():
    includes = "<include><uri>model://ground_plane</uri></include><include><uri>model://sun</uri></include>"
    loaded = world(includes)
    assert [m.name for m in loaded.models] == ["ground_plane"]
    assert loaded.models[0].static
    assert loaded.warnings == ()


def test_local_model_is_included_with_the_includes_name_and_pose(tmp_path):
    folder = tmp_path / "crate"
    folder.mkdir()
    (folder / "model.config").write_text(
        "<model><sdf version='1.4'>old.sdf</sdf><sdf version='1.6'>new.sdf</sdf><sdf version='1.9'>x.sdf</sdf></model>"
    )
    body = model(f"<link name='l'>{BOX}</link>", "crate")
    (folder / "new.sdf").write_text(f"<sdf version='1.6'>{body}</sdf>")
    own = "<name>left</name><pose>1 2 3 0 0 0</pose><static>true</static>"
    include = f"<include><uri>model://crate</uri>{own}</include>"
    (found,) = world(include, model_path=[tmp_path]).models
    assert (found.name, found.pose.position, found.static) == ("left", (1, 2, 3), True)


def test_model_that_is_not_found_is_named_once():
    loaded = world("<include><uri>model://cafe</uri></include>" * 3)
    assert loaded.warnings == ("model://cafe is not found along the model path and left out",)


def test_unsupported_elements_are_named_once_and_scenery_is_quiet():
    quiet = "<light type='directional' name='sun'/><scene><ambient>1 1 1 1</ambient></scene><gui/><audio/>"
    road = "<road name='{}'><point>{} 0 0</point></road>"
    loaded = world(quiet + road.format("a", 1) + road.format("b", 2) + "<hole/>")
    assert loaded.warnings == (
        "SDF, line 1: <road> in <world> has no effect (2 times)",
        "SDF, line 1: <hole> in <world> is unknown and ignored",
    )


def test_saved_state_moves_models_and_their_links():
    link = f"<link name='l'>{BOX}</link>"
    state = (
        "<state world_name='w'><model name='m'><pose>5 0 0 0 0 0</pose>"
        "<link name='l'><pose>6 1 0 0 0 0</pose></link></model></state>"
    )
    (found,) = world(model(link) + state).collisions()
    assert found.model.pose.position == (5, 0, 0)
    assert found.pose.position == pytest.approx((6, 1, 0))


def test_pose_relative_to_a_frame_is_resolved():
    frame = "<frame name='f'><pose>1 0 0 0 0 0</pose></frame>"
    link = f"<link name='l'><pose relative_to='f'>0 2 0 0 0 0</pose>{BOX}</link>"
    (found,) = world(model(frame + link), version="1.7").collisions()
    assert found.pose.position == (1, 2, 0)


def test_poses_in_a_circle_are_refused():
    frames = "".join(
        f"<frame name='{a}'><pose relative_to='{b}'>1 0 0 0 0 0</pose></frame>"
        for a, b in ("ab", "ba")
    )
    with pytest.raises(DescriptionError, match="loop: a → b → a"):
        world(
            model(frames + f"<link name='l'><pose relative_to='a'>0 0 0 0 0 0</pose>{BOX}</link>"),
            version="1.7",
        )


def test_nested_model_becomes_links_of_the_outer_one():
    inner = model(f"<pose>1 0 0 0 0 0</pose><link name='l'>{BOX}</link>", "inner")
    (found,) = world(model(f"<pose>0 1 0 0 0 0</pose>{inner}", "outer")).collisions()
    assert found.link.name == "inner::l"
    assert found.pose.position == (1, 1, 0)


def test_models_of_the_same_name_are_numbered():
    loaded = world(model("<link name='l'/>") * 3)
    assert [m.name for m in loaded.models] == ["m", "m_0", "m_1"]
    assert len(loaded.warnings) == 1


def test_mesh_is_found_beside_the_world(tmp_path):
    (tmp_path / "wall.stl").write_text("solid\nendsolid\n")
    geometry = "<geometry><mesh><uri>file://wall.stl</uri><scale>2 2 2</scale></mesh></geometry>"
    link = f"<link name='l'><collision name='c'>{geometry}</collision></link>"
    (found,) = world(model(link), directory=tmp_path).collisions()
    assert found.collision.shape == Mesh(str(tmp_path / "wall.stl"), (2, 2, 2))


def test_text_with_one_bare_model_is_a_world_of_it():
    loaded = world_from_sdf_text(
        "<sdf version='1.5'><model name='x'><link name='l'/></model></sdf>"
    )
    assert [m.name for m in loaded.models] == ["x"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<sdf version='1.6'><world name='w'>", "not well-formed XML"),
        ("", "not well-formed XML"),
        ("<robot name='r'/>", "must be <sdf>"),
        ("<sdf><world name='w'/></sdf>", '"version" is missing'),
        ("<sdf version='1.6'/>", "neither <world> nor <model>"),
    ],
)
def test_text_that_is_no_world_is_refused(text, message):
    with pytest.raises(DescriptionError, match=message):
        world_from_sdf_text(text, source="some.world")


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        (
            "<pose>1 2 3</pose>",
            r'some.world, line 1: .*<model name="m"> <pose>: needs 6 numbers, not 3',
        ),
        ("<pose>1 2 x 0 0 0</pose>", "'x' is not a number"),
        ("<pose>1 2 nan 0 0 0</pose>", "not a finite number"),
        ("<static>maybe</static>", "must be true or false"),
        ("<link/>", '"name" is missing'),
        (f"<link name='l'>{BOX.replace('1 2 3', '1 0 3')}</link>", "must be above 0"),
        (f"<link name='l'>{BOX.replace('<size>1 2 3</size>', '')}</link>", "<size> is missing"),
        ("<link name='l'><collision name='c'/></link>", "<geometry> is missing"),
    ],
)
def test_value_that_makes_no_sense_is_refused_with_file_and_element(inner, message):
    text = f"<sdf version='1.6'><world name='w'>{model(inner)}</world></sdf>"
    with pytest.raises(DescriptionError, match=message):
        world_from_sdf_text(text, source="some.world")


def test_include_of_itself_is_refused(tmp_path):
    folder = tmp_path / "loop"
    folder.mkdir()
    include = "<include><uri>model://loop</uri></include>"
    (folder / "model.sdf").write_text(f"<sdf version='1.6'>{model(include, 'loop')}</sdf>")
    with pytest.raises(DescriptionError, match="include itself"):
        world(include, model_path=[tmp_path])


def test_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(DescriptionError, match=r"none\.world: cannot be read"):
        world_from_sdf(tmp_path / "none.world")


def test_external_entities_are_not_read(tmp_path):
    (tmp_path / "secret").write_text("7")
    body = "<sdf version='1.6'><world name='w'><gravity>0 0 &e;</gravity></world></sdf>"
    text = f"<!DOCTYPE x [<!ENTITY e SYSTEM 'file://{tmp_path}/secret'>]>{body}"
    with pytest.raises(DescriptionError):
        world_from_sdf_text(text)


def test_written_world_reads_back_the_same():
    link = (
        f"<link name='l'>{BOX.replace('<geometry>', '<pose>0 1 0 0 0 0.5</pose><geometry>')}</link>"
    )
    original = world(
        "<include><uri>model://ground_plane</uri></include>" + model("<static>1</static>" + link)
    )
    again = world_from_sdf_text(sdf_from_world(original))
    ours, theirs = (
        [(c.model.name, c.collision.shape) for c in w.collisions()] for w in (original, again)
    )
    assert ours == theirs
    assert list(again.collisions())[1].pose.yaw == pytest.approx(
        Pose.from_rpy(yaw=0.5).yaw, abs=1e-5
    )


def test_an_includes_pose_may_be_relative_to_a_frame_and_be_referred_to(tmp_path):
    (tmp_path / "crate").mkdir()
    body = model(f"<link name='l'>{BOX}</link>", "crate")
    (tmp_path / "crate" / "model.sdf").write_text(f"<sdf version='1.7'>{body}</sdf>")
    frame = "<frame name='corner'><pose>10 0 0 0 0 1.5707963</pose></frame>"
    include = "<include><uri>model://crate</uri><name>c</name><pose relative_to='corner'>1 0 0 0 0 0</pose></include>"
    other = model(f"<pose relative_to='c'>0 1 0 0 0 0</pose><link name='l'>{BOX}</link>", "other")
    crate, beside = world(frame + include + other, version="1.7", model_path=[tmp_path]).models
    assert crate.pose.position == pytest.approx((10, 1, 0))
    assert beside.pose.position == pytest.approx((9, 1, 0))


@pytest.mark.parametrize("of", ["relative_to", "frame"])
def test_poses_in_a_link_may_be_relative_to_frames_and_links_of_the_model(of):
    shape = BOX.replace("<geometry>", f"<pose {of}='b'>1 0 0 0 0 0</pose><geometry>")
    turned = "<frame name='turned'><pose>0 0 0 0 0 1.5707963267948966</pose></frame>"
    other = BOX.replace("<geometry>", f"<pose {of}='turned'>2 0 0 0 0 0</pose><geometry>")
    inertial = f"<inertial><pose {of}='b'>0 0 1 0 0 0</pose><mass>2</mass></inertial>"
    links = f"<link name='a'><pose>0 5 0 0 0 0</pose>{inertial}{shape}{other}</link>"
    links += "<link name='b'><pose>3 0 0 0 0 0</pose></link>"
    loaded = world(model(turned + links), version="1.7")
    assert loaded.warnings == ()
    first, second = loaded.collisions()
    assert first.pose.position == pytest.approx((4, 0, 0))
    assert second.pose.position == pytest.approx((0, 2, 0))
    assert loaded.models[0].links[0].inertia.pose.position == pytest.approx((3, -5, 1))


def test_a_users_world_of_a_thousand_boxes_is_read_and_stands_within_two_seconds(
    tmp_path, simulate
):
    rng = np.random.default_rng(3)
    boxes = "".join(
        model(
            f"<static>true</static><pose>{x:.3f} {y:.3f} 0.5 0 0 {yaw:.3f}</pose>"
            f"<link name='link'><collision name='c'><geometry><box><size>1 0.2 1</size></box></geometry></collision>"
            f"<visual name='v'><geometry><box><size>1 0.2 1</size></box></geometry></visual></link>",
            f"wall_{number}",
        )
        for number, (x, y, yaw) in enumerate(rng.uniform(-40, 40, (1000, 3)))
    )
    path = tmp_path / "user.world"
    path.write_text(f"<sdf version='1.6'><world name='user'>{boxes}</world></sdf>")
    began = time.process_time()
    loaded = world_from_sdf(path)
    simulation = simulate()
    simulation.load(loaded)
    simulation.advance(12)
    assert time.process_time() - began < 2.0
    assert len(loaded.models) == 1000
    assert loaded.warnings == ()
