"""Cameras: objects appear in the picture where the intrinsics project them."""

from dataclasses import replace

import numpy as np
import pytest

from pioneer_gazebo.sensors.camera import intrinsics_of, noisy
from pioneer_gazebo.sensors.tiny_renderer import SKY, TinyRenderer
from pioneer_gazebo.topics import sensor_messages
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Box, Cylinder, Link, Mesh, Model, Plane, Sphere, Visual
from pioneer_gazebo.world.pose import IDENTITY, Pose
from pioneer_gazebo.world.robot import Camera

CAMERA = Camera("camera", "link", horizontal_fov=1.2, width=160, height=120, far=50.0)
EYE = Pose((0.0, 0.0, 1.0))
RED, GREEN, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)


def look(shape, pose, colour=RED):
    return Model("m", pose, True, (Link("l", visuals=(Visual("v", IDENTITY, shape, colour),)),))


@pytest.fixture
def renderer():
    made = TinyRenderer(triangles_of_mesh)
    yield made
    made.close()


def of_colour(picture, channel):
    """Returns a mask of the pixels where one channel is clearly above the other two."""
    others = np.delete(picture.astype(int), channel, axis=2).max(axis=2)
    return picture[:, :, channel].astype(int) > others + 40


def test_nothing_is_sky(renderer):
    assert (renderer.picture(CAMERA, EYE, [], [])[0] == SKY).all()


@pytest.mark.parametrize(("y", "z"), [(0.0, 1.0), (1.0, 1.0), (-1.2, 0.4), (0.5, 1.8)])
def test_a_ball_is_where_the_intrinsics_project_it(renderer, y, z):
    picture, _ = renderer.picture(CAMERA, EYE, [look(Sphere(0.2), Pose((4.0, y, z)))], [])
    rows, columns = np.nonzero(of_colour(picture, 0))
    lens = intrinsics_of(CAMERA)
    assert columns.mean() == pytest.approx(lens.x - lens.focal * y / 4.0, abs=1.0)
    assert rows.mean() == pytest.approx(lens.y - lens.focal * (z - 1.0) / 4.0, abs=1.0)
    assert np.ptp(columns) + 1 == pytest.approx(2 * 0.2 / 4.0 * lens.focal, abs=2.5)


def test_what_is_nearer_hides_what_is_behind_and_left_is_left(renderer):
    boxes = [
        look(Box((0.5, 0.5, 0.5)), Pose((3.0, 0.0, 1.0)), RED),
        look(Box((0.5, 2.0, 2.0)), Pose((6.0, 0.0, 1.0)), BLUE),
        look(Cylinder(0.2, 1.0), Pose((3.0, 1.2, 1.0)), GREEN),
    ]
    picture, _ = renderer.picture(CAMERA, EYE, boxes, [])
    assert of_colour(picture, 0)[60, 80]
    assert of_colour(picture, 2).sum() > of_colour(picture, 0).sum() / 4
    assert np.nonzero(of_colour(picture, 1))[1].max() < 60


def test_the_floor_is_below_the_horizon_only(renderer):
    picture, _ = renderer.picture(CAMERA, EYE, [look(Plane(size=(60.0, 60.0)), Pose(), GREEN)], [])
    floor = of_colour(picture, 1)
    assert floor[80:].all()
    assert not floor[:58].any()


def test_a_mesh_is_drawn(renderer, tmp_path):
    (tmp_path / "t.obj").write_text("v 0 -1 0\nv 0 1 0\nv 0 0 2\nf 1 2 3\nf 3 2 1\n")
    picture, _ = renderer.picture(
        CAMERA, EYE, [look(Mesh(str(tmp_path / "t.obj")), Pose((4.0, 0.0, 0.0)))], []
    )
    assert of_colour(picture, 0).sum() > 200


def test_what_moves_is_drawn_where_it_is_and_not_when_it_has_gone(renderer, simulate):
    crate = replace(look(Box((0.4, 0.4, 0.4)), Pose((3.0, 0.0, 1.0))), static=False, name="crate")
    simulation = simulate(crate)
    entity = simulation.entity("crate")

    def column(y):
        picture, _ = renderer.picture(CAMERA, EYE, [], [(entity, [Pose((3.0, y, 1.0))])])
        return np.nonzero(of_colour(picture, 0))[1].mean()

    assert column(1.0) < 50 < column(0.0) < 110 < column(-1.0)
    assert not of_colour(renderer.picture(CAMERA, EYE, [], [])[0], 0).any()


def test_messages_carry_format_and_intrinsics():
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[:, :, 0] = 200
    assert sensor_messages.image_of(picture, CAMERA).data[:3] == bytes((200, 0, 0))
    blue_first = sensor_messages.image_of(picture, replace(CAMERA, format="B8G8R8"))
    assert (blue_first.encoding, blue_first.data[:3]) == ("bgr8", bytes((0, 0, 200)))
    grey = sensor_messages.image_of(picture, replace(CAMERA, format="L8"))
    assert (grey.encoding, grey.step, grey.data[0], len(grey.data)) == ("mono8", 160, 59, 120 * 160)
    info = sensor_messages.info_of(CAMERA)
    assert info.K[0] == info.K[4] == pytest.approx(80 / np.tan(0.6))
    assert (info.K[2], info.K[5], info.distortion_model) == (79.5, 59.5, "plumb_bob")


def test_noise_is_that_of_its_seed():
    picture = np.full((50, 50, 3), 128, np.uint8)
    one, other = (noisy(picture, 0.02, np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(one, other)
    assert one.std() == pytest.approx(5.1, rel=0.1)
