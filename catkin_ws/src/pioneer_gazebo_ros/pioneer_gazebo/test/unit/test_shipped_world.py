"""The shipped drawings, worlds, maps and initial poses are consistent."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy import ndimage

from pioneer_gazebo.commands.plan_to_world import world_text
from pioneer_gazebo.commands.world_to_map import map_of_world
from pioneer_gazebo.world.sdf import world_from_sdf
from pioneer_gazebo.world.sdf_actor import PERSON_RADIUS

PACKAGE = Path(__file__).parents[2]
POSES = PACKAGE.parent / "pioneer_description" / "config"
NAMES = ["closed_maze", "utm_0", "small_world", "small_world_people", "willow_office", "blank"]
INSCRIBED_RADIUS, CIRCUMSCRIBED_RADIUS = 0.20, 0.37


def read_map(name):
    head = yaml.safe_load((PACKAGE / "map" / f"{name}.yaml").read_text())
    data = (PACKAGE / "map" / head["image"]).read_bytes()
    magic, width, height, depth, pixels = (
        data.split(maxsplit=4) if data[:2] == b"P5" else (None,) * 5
    )
    assert (magic, depth) == (b"P5", b"255")
    pixels = data[-int(width) * int(height) :]
    return head, np.frombuffer(pixels, np.uint8).reshape(int(height), int(width))[::-1]


def clearance(grey, resolution):
    return ndimage.distance_transform_edt(grey == 254) * resolution


@pytest.mark.parametrize("name", NAMES)
def test_shipped_map_agrees_with_its_world(name):
    head, grey = read_map(name)
    expected, extent = map_of_world(
        world_from_sdf(PACKAGE / "worlds" / f"{name}.world", [PACKAGE / "models"])
    )
    assert np.array_equal(grey, expected)
    assert head["origin"] == pytest.approx([extent.x, extent.y, 0.0])
    assert head["resolution"] == extent.resolution


@pytest.mark.parametrize("name", NAMES)
def test_shipped_world_is_read_without_a_warning(name):
    world = world_from_sdf(PACKAGE / "worlds" / f"{name}.world", [PACKAGE / "models"])
    assert world.name == name
    assert world.warnings == ()


@pytest.mark.parametrize(
    "plan", sorted((PACKAGE / "worlds" / "plan").glob("*.plan")), ids=lambda path: path.stem
)
def test_shipped_world_is_what_its_plan_draws(plan):
    assert (PACKAGE / "worlds" / f"{plan.stem}.world").read_text() == world_text(plan)


@pytest.mark.parametrize(
    ("name", "file", "count"),
    [
        ("closed_maze", "pioneer_poses.yaml", 15),
        ("utm_0", "pioneer_poses.yaml", 15),
        ("blank", "pioneer_poses.yaml", 15),
        ("willow_office", "pioneer_poses_willow_office.yaml", 15),
        ("small_world", "pioneer_poses_small_world.yaml", 6),
        ("small_world_people", "pioneer_poses_small_world_people.yaml", 6),
    ],
)
def test_all_initial_poses_are_free_and_connected_for_a_robot(name, file, count):
    head, grey = read_map(name)
    resolution, (x0, y0, _) = head["resolution"], head["origin"]
    room = clearance(grey, resolution)
    regions, _ = ndimage.label(room > INSCRIBED_RADIUS)
    poses = yaml.safe_load((POSES / file).read_text())
    assert sorted(poses) == sorted(f"pioneer{i}" for i in range(1, count + 1))
    cells = [
        (int((p["y"] - y0) / resolution), int((p["x"] - x0) / resolution)) for p in poses.values()
    ]
    assert min(room[cell] for cell in cells) > CIRCUMSCRIBED_RADIUS
    assert len({regions[cell] for cell in cells}) == 1


def test_two_robots_can_pass_each_other_between_any_poses_of_the_maze():
    head, grey = read_map("closed_maze")
    regions, count = ndimage.label(clearance(grey, head["resolution"]) > 0.8)
    assert count == 1
    assert regions.any()


def test_small_world_is_the_grid_of_the_original():
    drawing = """
        111111111111
        100111100001
        100111100001
        100110000001
        100110000001
        100000011001
        100000011001
        100000000001
        100000000001
        111111111111
    """
    head, grey = read_map("small_world")
    x0, y0, _ = head["origin"]
    for row, line in enumerate(drawing.split()):
        for col, solid in enumerate(line):
            x, y = -6.0 + col + 0.5, 5.0 - row - 0.5
            cell = grey[int((y - y0) / 0.05), int((x - x0) / 0.05)]
            assert cell == (0 if solid == "1" else 254), (row, col)


def test_small_world_people_is_small_world_with_two_who_walk_in_free_space():
    world = world_from_sdf(PACKAGE / "worlds" / "small_world_people.world", [PACKAGE / "models"])
    empty = world_from_sdf(PACKAGE / "worlds" / "small_world.world")
    people = [model for model in world.models if model.script is not None]
    assert [model.name for model in people] == ["person_1", "person_2"]
    assert tuple(model for model in world.models if model.script is None) == empty.models
    head, grey = read_map("small_world_people")
    room = clearance(grey, head["resolution"])
    x0, y0, _ = head["origin"]
    for person in people:
        for time in np.linspace(0.0, 14.0, 141):
            x, y, _ = person.script.pose(time).position
            assert room[int((y - y0) / 0.05), int((x - x0) / 0.05)] > PERSON_RADIUS
