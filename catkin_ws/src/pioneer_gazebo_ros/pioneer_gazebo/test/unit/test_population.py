"""Populations, prisms over polygons, and the physics of a world file."""

import math
import random

import numpy as np
import pytest

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.prism import prism, triangles_of_polygon
from pioneer_gazebo.world.sdf import world_from_sdf_text

CRATE = """<model name='crate'><pose>9 9 9 0 0 0.5</pose><static>1</static><link name='l'><collision name='c'><geometry>
<box><size>0.2 0.2 0.2</size></box></geometry></collision></link></model>"""


def world(content: str):
    return world_from_sdf_text(
        f"<sdf version='1.6'><world name='w'>{content}</world></sdf>", tolerant=True
    )


def population(distribution: str, region: str, count: int = 20, pose: str = "1 2 3 0 0 0"):
    kind = f"<distribution>{distribution}</distribution>" if distribution else ""
    inside = f"<pose>{pose}</pose>{CRATE}<model_count>{count}</model_count>{kind}{region}"
    return world(f"<population name='p'>{inside}</population>")


BOX, DRUM = (
    "<box><size>4 2 1</size></box>",
    "<cylinder><radius>2</radius><length>1</length></cylinder>",
)


@pytest.mark.parametrize("kind", ["random", "uniform"])
@pytest.mark.parametrize("region", [BOX, DRUM])
def test_a_population_fills_its_region_with_copies(kind, region):
    found = population(f"<type>{kind}</type>", region)
    assert found.warnings == ()
    assert [model.name for model in found.models] == [f"crate_clone_{i}" for i in range(20)]
    places = np.array([model.pose.position for model in found.models]) - (1, 2, 3)
    assert len(np.unique(places.round(6), axis=0)) == 20
    if region == BOX:
        assert (np.abs(places) <= (2, 1, 0.5)).all()
    else:
        assert (np.hypot(places[:, 0], places[:, 1]) <= 2).all()
    assert np.ptp(places[:, 0]) > 2
    assert {round(model.pose.yaw, 6) for model in found.models} == {0.5}
    assert found == population(f"<type>{kind}</type>", region), "each run has the same places"


def test_a_grid_has_rows_and_columns_about_the_populations_pose():
    grid = "<type>grid</type><rows>2</rows><cols>3</cols><step>1.5 2 0</step>"
    found = population(grid, BOX, pose="1 2 3 0 0 1.5707963267948966")
    places = sorted(tuple(round(v, 6) + 0.0 for v in model.pose.position) for model in found.models)
    assert places == [(x, y, 3.0) for x in (0.0, 2.0) for y in (0.5, 2.0, 3.5)]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_line_is_evenly_spaced_along_its_axis(axis):
    found = population(f"<type>linear-{'xyz'[axis]}</type>", BOX, count=4, pose="0 0 0 0 0 0")
    along = sorted(model.pose.position[axis] for model in found.models)
    size = (4, 2, 1)[axis]
    assert np.diff(along) == pytest.approx(size / 4)
    assert sum(along) == pytest.approx(0)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"<population name='p'>{CRATE}{BOX}</population>", "<model_count> is missing"),
        (f"<population name='p'>{CRATE}<model_count>2</model_count></population>", "needs a <box> or a <cylinder>"),
        (f"<population name='p'>{CRATE}<model_count>1e9</model_count>{BOX}</population>", "must be 1 to 10000"),
        (f"<population name='p'><model_count>2</model_count>{BOX}</population>", "<include> is missing"),
        (f"<population name='p'>{CRATE}<model_count>2</model_count>{BOX}<distribution><type>heap</type></distribution>"
         "</population>", "not 'heap'"),
    ],
)  # fmt: skip
def test_a_population_that_cannot_be_is_left_out_with_the_reason(text, reason):
    found = world(text + CRATE)
    assert [model.name for model in found.models] == ["crate"]
    [line] = found.warnings
    assert reason in line


def area_of(triangles) -> float:
    return sum(
        abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2
        for a, b, c in triangles
    )


@pytest.mark.parametrize("seed", range(30))
def test_random_polygons_are_covered_by_triangles_once(seed):
    """Star-shaped polygons of both directions, with concave corners; the area tells gaps and overlaps."""
    rng = random.Random(seed)
    count = rng.randint(3, 40)
    # Not more than a third of the circle apart: otherwise the polygon is not star-shaped about the origin.
    angles = sorted([0.0, 2.0, 4.0, *(rng.uniform(0, math.tau) for _ in range(count - 3))])
    corners = [(r * math.cos(a), r * math.sin(a)) for a in angles if (r := rng.uniform(0.5, 3.0))]
    pairs = list(zip(corners, corners[1:] + corners[:1], strict=True))
    area = sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs) / 2
    assert area_of(triangles_of_polygon(corners)) == pytest.approx(area)
    solid = np.array(prism(corners[::-1], 2.0)).reshape(-1, 3, 3)
    volume = np.einsum("ni,ni->n", solid[:, 0], np.cross(solid[:, 1], solid[:, 2])).sum() / 6
    assert volume == pytest.approx(2.0 * area), "all faces point outwards"


@pytest.mark.parametrize(
    ("corners", "reason"),
    [
        ([(0, 0), (1, 0)], "needs 3"),
        ([(0, 0), (1, 0), (2, 0)], "no area"),
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "crosses itself"),
        ([(0, 0), (4, 0), (4, 3), (1, -1), (0, 3)], "crosses itself"),
    ],
)
def test_a_polygon_without_area_is_refused(corners, reason):
    with pytest.raises(ValueError, match=reason):
        prism(corners, 1.0)


POLYLINE = """<model name='m'><static>1</static><link name='l'><collision name='c'><geometry><polyline>{}
<height>1.5</height></polyline></geometry></collision></link></model>"""
L_SHAPE = [(1, -1), (3, -1), (3, 0), (2, 0), (2, 1), (1, 1), (1, -1)]


def test_lasers_see_the_walls_of_a_polyline_and_robots_stop_at_them(simulate, robot):
    points = "".join(f"<point>{x} {y}</point>" for x, y in L_SHAPE)
    found = world(POLYLINE.format(points))
    assert found.warnings == ()
    [model] = found.models
    triangles = triangles_of_mesh(model.links[0].collisions[0].shape)
    assert triangles[..., 2].max() == 1.5
    simulation = simulate(model)
    entity = simulation.add_robot("p", "", robot, Pose())
    ranges = simulation.ranges(entity, entity.lasers[0])
    eye = simulation.link_pose(entity, "laser").position[0]
    assert ranges[len(ranges) // 2] == pytest.approx(1.0 - eye, abs=0.03)
    entity.drives[0].command(simulation.moment, 0.5, 0.0)
    simulation.advance(2400)
    assert simulation.pose(entity).position[0] < 0.9


def test_a_polyline_that_crosses_itself_is_left_out_with_its_line():
    points = "".join(f"<point>{x} {y}</point>" for x, y in [(0, 0), (2, 2), (2, 0), (0, 1), (0, 2)])
    [line, *_] = world(POLYLINE.format(points) + CRATE).warnings
    assert "line 1" in line
    assert "crosses itself" in line


@pytest.mark.parametrize(
    ("physics", "factor"),
    [
        ("", None),
        (
            "<max_step_size>0.001</max_step_size><real_time_update_rate>1000</real_time_update_rate>",
            1.0,
        ),
        (
            "<max_step_size>0.001</max_step_size><real_time_update_rate>500</real_time_update_rate>",
            0.5,
        ),
        (
            "<max_step_size>0.002</max_step_size><real_time_update_rate>0</real_time_update_rate>",
            0.0,
        ),
        (
            "<real_time_factor>3</real_time_factor><real_time_update_rate>0</real_time_update_rate>",
            3.0,
        ),
        ("<real_time_factor>3</real_time_factor>", 1.0),
        ("<max_step_size>-1</max_step_size>", -1.0),
    ],
)
def test_a_worlds_physics_give_the_real_time_factor_and_one_line_about_the_step(physics, factor):
    found = world(
        CRATE
        + f"<physics type='ode'>{physics}<ode><solver><iters>50</iters></solver></ode></physics>"
    )
    if factor == -1.0:
        assert any("real-time factor must be 0" in line for line in found.warnings)
        return
    assert found.real_time_factor == (None if factor is None else pytest.approx(factor))
    lines = [line for line in found.warnings if "<physics>" in line]
    assert len(lines) == ("max_step_size" in physics)
    assert all("steps are the simulator's own" in line for line in lines)


def test_an_empty_population_name_is_refused_by_strict_readers():
    with pytest.raises(DescriptionError):
        world_from_sdf_text(
            "<sdf version='1.6'><world name='w'><population name='p'/></world></sdf>"
        )


@pytest.mark.parametrize(
    "physics",
    [
        "<max_step_size>-0.001</max_step_size>",
        "<max_step_size>-1</max_step_size><real_time_update_rate>-1</real_time_update_rate>",
        "<real_time_update_rate>0</real_time_update_rate><real_time_factor>-5</real_time_factor>",
        "<max_step_size>1</max_step_size><real_time_update_rate>1e9</real_time_update_rate>",
    ],
)
def test_a_factor_of_a_world_that_is_refused_is_not_taken(physics):
    """It was named as ignored, and taken: as fast as possible."""
    found = world(f"<physics type='ode'>{physics}</physics>{CRATE}")
    assert found.real_time_factor is None
    assert any("it is ignored" in line for line in found.warnings)


@pytest.mark.parametrize(
    "region",
    [
        "<box><size>1e308 1 1</size></box>",
        "<box><size>-4 2 1</size></box>",
        "<cylinder><radius>1e308</radius><length>1</length></cylinder>",
    ],
)
@pytest.mark.parametrize("kind", ["random", "uniform"])
def test_a_population_in_an_impossible_region_is_left_out(region, kind):
    """Copies in a cylinder of 1e308 m were sought for ever; a box of such a width ended the simulator."""
    found = population(f"<type>{kind}</type>", region)
    assert found.models == ()
    assert any("must be 0 to 100000 m wide" in line for line in found.warnings)


@pytest.mark.parametrize(
    "polygon",
    [
        [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (1, 2), (1, 1), (0, 1)],
        [(0, 0), (1, 0), (0, 0), (0, 1)],
    ],
)
def test_a_polygon_that_comes_to_a_point_twice_is_refused(polygon):
    """The second visit was left out, which made another shape."""
    with pytest.raises(ValueError, match="comes to a point twice"):
        prism([(float(x), float(y)) for x, y in polygon], 1.0)
