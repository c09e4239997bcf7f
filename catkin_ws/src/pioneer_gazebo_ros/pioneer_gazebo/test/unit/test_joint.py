"""Joints of a world's models: how they are read, how they move, and what lasers see of them."""

import math

import pytest

from pioneer_gazebo.body.body import body_from_model
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.simulation.actor import Effort, Wrench
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.world.joint import CONTINUOUS, FIXED, PRISMATIC, REVOLUTE, Joint, tree_of
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Box, Collision, Link, Mesh, Model
from pioneer_gazebo.world.pose import IDENTITY, Pose
from pioneer_gazebo.world.sdf import world_from_sdf_text
from pioneer_gazebo.world.urdf import robot_from_urdf


def link(name, pose="0 0 0 0 0 0", size="0.2 0.2 0.2", mass=1):
    return (
        f"<link name='{name}'><pose>{pose}</pose><inertial><mass>{mass}</mass>"
        "<inertia><ixx>.1</ixx><iyy>.1</iyy><izz>.1</izz></inertia></inertial>"
        f"<collision name='c'><geometry><box><size>{size}</size></box></geometry></collision></link>"
    )


def joint(name, kind, parent, child, inner="<axis><xyz>0 0 1</xyz></axis>"):
    return f"<joint name='{name}' type='{kind}'><parent>{parent}</parent><child>{child}</child>{inner}</joint>"


def model_of(*parts, version="1.6", name="m", notes=()):
    text = f"<sdf version='{version}'><world name='w'><model name='{name}'>{''.join(parts)}</model></world></sdf>"
    world = world_from_sdf_text(text)
    assert world.warnings == tuple(notes)
    return world.models[0]


# A door 1 m wide, hinged at x = 3.0, y = 0.5, that closes the way along the x axis; it swings about its left edge.
DOOR = (
    "<pose>3 0 0 0 0 0</pose>",
    link("leaf", "0 0 1 0 0 0", "0.05 1 1.9", 5),
    joint(
        "hinge",
        "revolute",
        "world",
        "leaf",
        "<pose>0 0.5 0 0 0 0</pose><axis><xyz>0 0 1</xyz><limit><lower>-1.5</lower><upper>1.5</upper></limit>"
        "<dynamics><damping>0.5</damping></dynamics></axis>",
    ),
)


def seconds(value):
    return round(value * TICK_RATE)


def test_a_hinge_is_read_with_its_place_axis_limits_and_damping():
    (hinge,) = model_of(*DOOR).joints
    assert (hinge.kind, hinge.parent, hinge.child) == (REVOLUTE, "world", "leaf")
    assert hinge.pose.position == pytest.approx((0, 0.5, 1))
    assert hinge.offset.position == pytest.approx((0, -0.5, 0))
    assert (hinge.lower, hinge.upper, hinge.damping) == (-1.5, 1.5, 0.5)


def test_a_revolute_joint_without_limits_is_continuous():
    limit = "<axis><xyz>0 0 1</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis>"
    (found,) = model_of(
        link("a"), link("b", "1 0 0 0 0 0"), joint("j", "revolute", "a", "b", limit)
    ).joints
    assert found.kind == CONTINUOUS


@pytest.mark.parametrize(
    ("version", "axis", "expected"),
    [
        ("1.6", "<xyz>1 0 0</xyz>", (1, 0, 0)),
        ("1.4", "<xyz>1 0 0</xyz>", (0, -1, 0)),
        ("1.6", "<xyz>1 0 0</xyz><use_parent_model_frame>1</use_parent_model_frame>", (0, -1, 0)),
        ("1.7", "<xyz expressed_in='__model__'>1 0 0</xyz>", (0, -1, 0)),
        ("1.7", "<xyz expressed_in='a'>1 0 0</xyz>", (0, -1, 0)),
    ],
)
def test_an_axis_is_given_in_the_joints_or_the_models_frame(version, axis, expected):
    turned = link("b", f"1 0 0 0 0 {math.pi / 2}")
    found = model_of(
        link("a"), turned, joint("j", "revolute", "a", "b", f"<axis>{axis}</axis>"), version=version
    )
    assert found.joints[0].axis == pytest.approx(expected)


def test_kinds_that_are_not_supported_and_rings_are_named_once():
    parts = (
        link("a"), link("b"), link("c"), joint("j", "ball", "a", "b", ""), joint("k", "universal", "b", "c", ""),
        joint("l", "fixed", "a", "c", ""),
    )  # fmt: skip
    notes = (
        "joint type 'ball' is not supported: the links it connects are held together",
        "joint type 'universal' is not supported: the links it connects are held together",
        "joint k of model m closes a kinematic loop, which is not supported; it is ignored",
    )
    found = model_of(*parts, notes=notes)
    assert [one.kind for one in found.joints] == [FIXED, FIXED]


@pytest.mark.parametrize(
    ("broken", "word"),
    [
        (joint("j", "revolute", "a", "nobody"), "no link 'nobody'"),
        (joint("j", "revolute", "a", "b", ""), "<axis> is missing"),
        (joint("j", "revolute", "a", "b", "<axis><xyz>0 0 0</xyz></axis>"), "must not be 0 0 0"),
        (
            joint(
                "j",
                "prismatic",
                "a",
                "b",
                "<axis><limit><lower>2</lower><upper>1</upper></limit></axis>",
            ),
            "lower 2 is above upper 1",
        ),
    ],
)
def test_a_joint_that_makes_no_sense_is_refused_by_name(broken, word):
    with pytest.raises(DescriptionError, match=word):
        model_of(link("a"), link("b"), broken)


def test_a_tree_is_turned_away_from_its_root_and_takes_loose_links_along():
    links = {"a": IDENTITY, "b": Pose((1.0, 0.0, 0.0)), "c": Pose((0.0, 2.0, 0.0))}
    backwards = Joint(
        "j",
        REVOLUTE,
        "b",
        "a",
        Pose((-0.5, 0.0, 0.0)),
        (0.0, 0.0, 1.0),
        offset=Pose((-0.5, 0.0, 0.0)),
    )
    tree, closing = tree_of(links, [backwards])
    assert closing == ()
    turned, held = tree
    assert (turned.parent, turned.child, turned.axis) == ("a", "b", (0.0, 0.0, -1.0))
    assert turned.pose.compose(turned.offset).position == pytest.approx((1, 0, 0))
    assert (held.kind, held.child, held.pose.position) == (FIXED, "c", (0.0, 2.0, 0.0))


def test_links_stand_where_the_file_puts_them_whatever_the_joints_frames():
    body = body_from_model(model_of(*DOOR), triangles_of_mesh)
    part, at = body.part_of("leaf")
    assert part == 1
    assert body.parts[0].mass == 0
    assert body.parts[1].joint.pose.compose(at).position == pytest.approx((0, 0, 1))


def test_a_pushed_door_opens_to_its_limit_and_lasers_see_it_open(simulate, robot):
    simulation = simulate(model_of(*DOOR))
    door = simulation.entity("m")
    entity = simulation.add_robot("r", "", robot, Pose())
    [mounted] = entity.lasers
    ahead = mounted.laser.config.samples // 2
    simulation.advance(seconds(0.2))
    eye = simulation.link_pose(entity, "laser").position[0]
    assert simulation.ranges(entity, mounted)[ahead] == pytest.approx(3 - 0.025 - eye, abs=0.05)
    simulation.push(Wrench(door, 1, (0.0, 0.0, 0.0), (0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 0, math.inf))
    simulation.advance(seconds(4.0))
    [(angle, speed)] = simulation.joints(door, [1])
    assert speed == pytest.approx(0.0, abs=1e-9)
    assert 1.5 - 0.01 < angle < 1.5 + 1e-3
    assert simulation.ranges(entity, mounted)[ahead] > 4.0
    assert simulation.link_pose(door, "leaf").position[0] == pytest.approx(
        3 + 0.5 * math.sin(1.5), abs=0.03
    )
    simulation.reset_poses()
    assert simulation.joints(door, [1]) == [(0.0, 0.0)]


def test_a_robot_pushes_a_door_open(simulate, robot):
    simulation = simulate(model_of(*DOOR))
    entity = simulation.add_robot("r", "", robot, Pose((2.0, -0.2, 0.0)))
    entity.drives[0].drive.command(0.5, 0.0)
    simulation.advance(seconds(3.0))
    [(angle, _)] = simulation.joints(simulation.entity("m"), [1])
    assert abs(angle) > 0.3
    assert simulation.pose(entity).position[0] > 2.8


def test_a_drawer_slides_between_its_limits(simulate):
    slide = "<axis><xyz>1 0 0</xyz><limit><lower>0</lower><upper>0.4</upper></limit></axis>"
    cabinet = model_of(
        link("case", "0 0 0.3 0 0 0", "0.4 0.4 0.6", 20),
        link("drawer", "0 0.5 0.3 0 0 0", "0.3 0.3 0.2"),
        joint("slide", "prismatic", "case", "drawer", slide),
    )
    assert cabinet.joints[0].kind == PRISMATIC
    simulation = simulate(cabinet)
    entity = simulation.entity("m")
    simulation.push(
        Wrench(entity, 1, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.5, 0.3), 0, math.inf)
    )
    simulation.advance(seconds(2.0))
    [(position, _)] = simulation.joints(entity, [1])
    assert position == pytest.approx(0.4, abs=0.02)


def test_joints_of_a_nested_model_carry_its_name():
    inner = f"<model name='in'><pose>1 0 0 0 0 0</pose>{''.join(DOOR[1:])}</model>"
    found = model_of(inner)
    (hinge,) = found.joints
    assert (hinge.name, hinge.parent, hinge.child) == ("in::hinge", "world", "in::leaf")
    assert hinge.pose.position == pytest.approx((1, 0.5, 1))


def test_a_world_may_hold_what_touches_but_a_spawned_model_may_not_stand_inside(simulate, box):
    simulation = simulate(
        box("wall", Pose((2.0, 0.0, 0.5)), (0.2, 4.0, 1.0)),
        box("crate", Pose((2.0, 0.0, 0.3)), (0.5, 0.5, 0.5), False),
    )
    assert "crate" in simulation.names()


def test_a_plane_in_a_model_that_moves_is_named_and_left_out():
    plane = "<link name='l'><collision name='c'><geometry><plane/></geometry></collision></link>"
    found = model_of(
        plane, notes=["a plane in model m, which is not static, is not supported and left out"]
    )
    assert found.links[0].collisions == ()


def test_a_moving_link_holds_several_meshes_and_many_shapes(simulate, tmp_path):
    corners = [(0, 0, 0), (0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.2)]
    text = (
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    )
    (tmp_path / "t.obj").write_text(text)
    mesh = Mesh(str(tmp_path / "t.obj"))
    shapes = [Collision(f"mesh{i}", Pose((0.3 * i, 0.0, 0.0)), mesh) for i in range(2)]
    shapes += [
        Collision(f"box{i}", Pose((0.1 * i, 0.5, 0.1)), Box((0.1, 0.1, 0.2))) for i in range(40)
    ]
    simulation = simulate(
        Model("heap", Pose((0.0, 0.0, 0.3)), links=(Link("l", collisions=tuple(shapes)),))
    )
    simulation.advance(seconds(2.0))
    x, y, z = simulation.pose(simulation.entity("heap")).position
    assert -0.05 < z < 0.05
    assert math.hypot(x, y) < 0.3


def test_a_robot_whose_root_is_called_world_is_held_where_it_stands(simulate):
    inertial = "<inertial><mass value='5'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial>"
    shape = "<collision><geometry><box size='0.2 0.2 0.2'/></geometry></collision>"
    mount = "<joint name='j' type='fixed'><origin xyz='0 0 1'/><parent link='world'/><child link='base'/></joint>"
    links = f"<link name='world'/><link name='base'>{inertial}{shape}</link>"
    simulation = simulate()
    entity = simulation.add_robot(
        "arm", "", robot_from_urdf(f"<robot name='r'>{links}{mount}</robot>"), Pose()
    )
    simulation.advance(seconds(2.0))
    assert simulation.link_pose(entity, "base").position == pytest.approx((0, 0, 1), abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "axis", "mass", "effort"),
    [
        ("prismatic", "0 0 1", 20.0, 0.0),
        ("prismatic", "0 0 1", 400.0, 0.0),
        ("prismatic", "1 0 0", 2.0, 100.0),
        ("prismatic", "1 0 0", 2.0, -300.0),
        ("revolute", "0 0 1", 2.0, 20.0),
        ("revolute", "0 1 0", 5.0, -40.0),
    ],
)
@pytest.mark.parametrize("sides", [(-0.4, 0.5), (-0.4, 1e16), (-1e16, 0.5)])
def test_no_load_and_no_speed_takes_a_joint_past_its_limit(
    simulate, kind, axis, mass, effort, sides
):
    """Beyond a limit, pybullet holds a joint where it is, up to 100 N."""
    lower, upper = sides
    limit = f"<limit><lower>{lower}</lower><upper>{upper}</upper></limit>"
    mount = "<joint name='w' type='fixed'><parent>world</parent><child>a</child></joint>"
    simulation = simulate(model_of(
        link("a", "0 0 2 0 0 0"), link("b", "0 0 2 0 0 0", mass=mass), mount,
        joint("j", kind, "a", "b", f"<axis><xyz>{axis}</xyz>{limit}</axis>"),
    ))  # fmt: skip
    entity = simulation.entity("m")
    part = entity.body.joint_index("j")
    if effort:
        simulation.push(Effort(entity, part, effort, 0.0, math.inf))
    for _ in range(100):
        simulation.advance(simulation.tick + 12)
        [(position, _)] = simulation.joints(entity, [part])
        assert lower - 1e-3 <= position <= upper + 1e-3
    if effort > 0 and upper < 1:
        assert position == pytest.approx(upper, abs=1e-3)
