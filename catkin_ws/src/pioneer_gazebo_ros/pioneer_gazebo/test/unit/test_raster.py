import math

import numpy as np
import pytest

from pioneer_gazebo.commands.raster import FREE, OCCUPIED, UNKNOWN, Extent, grey_map, occupied_cells
from pioneer_gazebo.world.model import Box, Cylinder, Mesh
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.section import section_of

CUBE = np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 4, 1], [1, 4, 5], [2, 3, 6], [3, 7, 6], [0, 2, 4],
                 [2, 6, 4], [1, 5, 3], [3, 5, 7]])  # fmt: skip
CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)


def cube(mesh):
    return CORNERS[CUBE] * np.asarray(mesh.scale)


def drawn(*solids, size=10, resolution=1.0):
    extent = Extent(0.0, 0.0, resolution, size, size)
    return occupied_cells([section_of(shape, pose, 0.0, cube) for shape, pose in solids], extent)


def art(grid):
    return "\n".join("".join("#" if cell else "." for cell in row) for row in grid[::-1])


def test_box_on_cell_borders_fills_its_cells_and_no_more():
    grid = drawn((Box((2, 3, 1)), Pose((4.0, 4.5, 0.0))), size=8)
    assert art(grid) == "\n".join(["........"] * 2 + ["...##..."] * 3 + ["........"] * 3)


def test_every_cell_that_a_box_overlaps_is_occupied():
    grid = drawn((Box((2.2, 0.2, 1)), Pose((4.0, 4.5, 0.0))), size=8)
    assert art(grid).splitlines()[3] == "..####.."
    assert grid.sum() == 4


def test_thin_slanted_wall_has_no_gaps():
    grid = drawn((Box((10, 0.001, 1)), Pose.from_rpy(5, 5, 0, yaw=0.4)))
    rows, cols = np.nonzero(grid)
    assert set(cols) == set(range(min(cols), max(cols) + 1))
    steps = [set(rows[cols == c]) & set(rows[cols == c + 1]) for c in range(min(cols), max(cols))]
    assert all(steps)


def test_disc_covers_the_cells_it_overlaps():
    grid = drawn((Cylinder(2.0, 1.0), Pose((4.5, 4.5, 0.0))), size=9)
    assert art(grid).splitlines()[2:7] == [
        "...###...",
        "..#####..",
        "..#####..",
        "..#####..",
        "...###...",
    ]


def test_inside_of_a_mesh_is_filled():
    mesh = drawn((Mesh("cube", (2.0, 2.0, 1.0)), Pose((5.0, 5.0, 0.0))))
    box = drawn((Box((4, 4, 2)), Pose((5.0, 5.0, 0.0))))
    assert np.array_equal(mesh, box)


@pytest.mark.parametrize("yaw", [0.0, 0.3, math.pi / 4, 1.2])
def test_area_of_a_turned_box_is_kept(yaw):
    grid = drawn((Box((20, 10, 1)), Pose.from_rpy(25, 25, 0, yaw=yaw)), size=500, resolution=0.1)
    assert grid.sum() * 0.01 == pytest.approx(200, rel=0.02)


def test_what_lies_outside_the_grid_is_left_out():
    assert not drawn((Box((2, 2, 1)), Pose((-5.0, 30.0, 0.0)))).any()


def test_extent_fits_the_sections_and_lies_on_whole_cells():
    section = section_of(Box((1.0, 2.0, 1.0)), Pose((0.03, 0.0, 0.0)), 0.0, cube)
    extent = Extent.around([section], 0.1, 0.5)
    assert (extent.x, extent.y) == pytest.approx((-1.0, -1.5))
    assert (extent.cols, extent.rows) == (21, 30)


def test_outside_of_closed_walls_is_unknown():
    ring = np.zeros((7, 7), dtype=bool)
    ring[1:6, 1:6] = True
    ring[2:5, 2:5] = False
    grey = grey_map(ring)
    assert (grey[0, 0], grey[1, 1], grey[3, 3]) == (UNKNOWN, OCCUPIED, FREE)
    assert grey_map(ring, outside_unknown=False)[0, 0] == FREE


def test_world_that_encloses_nothing_is_free():
    wall = np.zeros((5, 5), dtype=bool)
    wall[2, 2] = True
    assert grey_map(wall)[0, 0] == FREE
