"""Properties that hold for every map: files, inflation, rays, outlines, paths, particle counts.

The examples are the same in every run.
"""

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from nav_bundle.base.pose import Pose
from nav_bundle.costmap import costmap_kernel as kernel
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.cost import FREE, INSCRIBED, LETHAL, cost_by_squared_distance
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.costmap_kernel import Place, Rays
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.particle_filter import ParticleFilter
from nav_bundle.maps.grid import OCCUPIED, UNKNOWN, Grid
from nav_bundle.maps.map_file import read_map, write_map
from nav_bundle.planning.global_planner import GlobalPlanner, GlobalPlannerConfig
from nav_bundle.planning.navfn import NavfnConfig, NavfnPlanner
from nav_bundle.planning.planner import NoPathError, path_between

alike = settings(derandomize=True, deadline=None, max_examples=50)

sides = st.integers(1, 24)
shapes = st.tuples(sides, sides)
origins = st.builds(Pose, st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3))
pixels = arrays(np.uint8, shapes)
trinary_cells = arrays(np.int8, shapes, elements=st.sampled_from([FREE, OCCUPIED, UNKNOWN]))


def obstacles(side: int, most: int = 30) -> st.SearchStrategy[NDArray[np.uint8]]:
    """Draws costs of ``side`` x ``side`` cells, all free except for at most ``most`` lethal ones."""
    places = st.lists(st.tuples(st.integers(0, side - 1), st.integers(0, side - 1)), max_size=most)

    def drawn(cells: list[tuple[int, int]]) -> NDArray[np.uint8]:
        costs = np.zeros((side, side), np.uint8)
        for cell in cells:
            costs[cell] = LETHAL
        return costs

    return places.map(drawn)


@alike
@given(trinary_cells, st.floats(0.01, 1), origins)
def test_a_map_that_was_saved_is_loaded_as_it_was(
    cells: NDArray[np.int8], resolution: float, origin: Pose
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _, description = write_map(Grid(resolution, origin, cells), Path(folder) / "map")
        read = read_map(description)
    assert (read.cells == cells).all()
    assert (read.resolution, read.origin) == (resolution, origin)


def loaded(image: NDArray[np.uint8], **fields: object) -> NDArray[np.int8]:
    """Returns the cells of a map with ``fields`` in its YAML file, the image's top row first."""
    with tempfile.TemporaryDirectory() as folder:
        Image.fromarray(image).save(Path(folder) / "map.pgm")
        description = {"image": "map.pgm", "resolution": 0.1, "origin": [0.0, 0.0, 0.0], **fields}
        Path(folder, "map.yaml").write_text(yaml.safe_dump(description))
        return read_map(Path(folder) / "map.yaml").cells[::-1]


@alike
@given(pixels)
def test_a_raw_map_s_cells_are_its_pixels_as_signed_bytes(image: NDArray[np.uint8]) -> None:
    assert (loaded(image, mode="raw") == image.view(np.int8)).all()


@alike
@given(pixels, st.booleans(), st.floats(0.0, 0.49), st.floats(0.51, 1.0))
def test_thresholds_part_free_unknown_and_occupied(
    image: NDArray[np.uint8], negate: bool, free: float, occupied: float
) -> None:
    terms = {"negate": int(negate), "free_thresh": free, "occupied_thresh": occupied}
    dark = (image if negate else 255 - image.astype(int)) / 255.0
    trinary, scaled = loaded(image, **terms), loaded(image, mode="scale", **terms)
    assert (
        trinary == np.where(dark > occupied, OCCUPIED, np.where(dark < free, FREE, UNKNOWN))
    ).all()
    between = trinary == UNKNOWN
    assert (scaled[~between] == trinary[~between]).all()
    assert (scaled[between] >= 1).all()
    assert (scaled[between] <= 99).all()
    order = np.argsort(dark[between], kind="stable")
    assert (np.diff(scaled[between][order].astype(int)) >= 0).all()


def inflated(costs: NDArray[np.uint8], radius: int, scaling: float) -> NDArray[np.uint8]:
    """Returns the costs inflated up to ``radius`` [cells], with an inscribed radius of two cells."""
    cells = costs.copy()
    kernel.inflate(
        cells, (0, cells.shape[0], 0, cells.shape[1]), radius, table_of(radius, scaling), False
    )
    return cells


def table_of(radius: int, scaling: float) -> NDArray[np.uint8]:
    return cost_by_squared_distance(radius, 1.0, 2.0, scaling)


@alike
@given(obstacles(20, 8), st.integers(1, 7), st.floats(0.1, 2.0))
def test_inflation_is_exact_and_never_rises_with_distance(
    costs: NDArray[np.uint8], radius: int, scaling: float
) -> None:
    cells, table = inflated(costs, radius, scaling), table_of(radius, scaling)
    places = np.argwhere(costs == LETHAL)
    assert (np.diff(table.astype(int)) <= 0).all()
    for (row, col), cost in np.ndenumerate(cells):
        square = (
            int(((places - (row, col)) ** 2).sum(axis=1).min())
            if len(places)
            else radius * radius + 1
        )
        assert cost == (table[square] if square <= radius * radius else FREE)


@alike
@given(obstacles(20, 8), obstacles(20, 8), st.integers(1, 7))
def test_more_obstacles_make_nothing_cheaper(
    few: NDArray[np.uint8], others: NDArray[np.uint8], radius: int
) -> None:
    assert (inflated(np.maximum(few, others), radius, 0.5) >= inflated(few, radius, 0.5)).all()


@alike
@given(
    st.tuples(st.floats(0.5, 5.5), st.floats(0.5, 5.5)),
    st.floats(-math.pi, math.pi),
    st.floats(0.05, 6.0),
)
def test_a_ray_clears_the_way_to_its_hit_and_nothing_behind_or_beside_it(
    sensor: tuple[float, float], bearing: float, reach: float
) -> None:
    cells = np.full((60, 60), LETHAL, np.uint8)
    ahead = np.array([math.cos(bearing), math.sin(bearing)])
    hit = np.array(sensor) + reach * ahead
    kernel.clear_rays(cells, Place(0.0, 0.0, 0.1), Rays(*sensor, hit[None, :], 10.0))
    cleared = np.argwhere(cells == FREE)
    centres = (cleared[:, ::-1] + 0.5) * 0.1 - sensor
    assert cells[int(sensor[1] / 0.1), int(sensor[0] / 0.1)] == FREE
    assert (centres @ ahead <= reach + 0.15).all()
    assert (np.abs(centres @ np.array([-ahead[1], ahead[0]])) <= 0.15).all()


@alike
@given(
    st.tuples(st.floats(1, 5), st.floats(1, 5)),
    st.floats(-math.pi, math.pi),
    st.floats(0.3, 0.9),
    st.floats(0.3, 0.9),
)
def test_a_filled_outline_has_the_cells_inside_and_none_far_outside(
    centre: tuple[float, float], yaw: float, length: float, width: float
) -> None:
    cells = np.zeros((60, 60), np.uint8)
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * (length, width)
    kernel.fill_polygon(
        cells, Place(0.0, 0.0, 0.1), np.ascontiguousarray(corners @ turn + centre), LETHAL
    )
    rows, cols = np.mgrid[0:60, 0:60]
    points = (np.stack([cols, rows], axis=-1) + 0.5) * 0.1 - centre
    beyond = (np.abs(points @ turn.T) - (length, width)).max(axis=-1)
    assert (cells[beyond < -0.08] == LETHAL).all()
    assert (cells[beyond > 0.15] == FREE).all()


PLANNERS = {
    "navfn": NavfnPlanner(NavfnConfig()),
    "dijkstra": GlobalPlanner(GlobalPlannerConfig()),
    "a*": GlobalPlanner(GlobalPlannerConfig(use_dijkstra=False)),
}
spots = st.tuples(st.integers(1, 30), st.integers(1, 30))


@pytest.mark.parametrize("planner", PLANNERS.values(), ids=PLANNERS.keys())
@alike
@given(cells=obstacles(32, 60), start=spots, goal=spots)
def test_a_path_never_leads_through_what_the_robot_would_touch(
    planner: NavfnPlanner, cells: NDArray[np.uint8], start: tuple[int, int], goal: tuple[int, int]
) -> None:
    parameters = {
        "static_map": True,
        "robot_radius": 0.12,
        "footprint_padding": 0.0,
        "inflation_radius": 0.4,
    }
    costmap = Costmap(costmap_config_from_parameters(parameters, "test"))
    costmap.set_map(Grid(0.1, Pose(), np.where(cells == LETHAL, OCCUPIED, FREE).astype(np.int8)))
    ends = [Pose((col + 0.5) * 0.1, (row + 0.5) * 0.1) for row, col in (start, goal)]
    costmap.update(ends[0], [])
    place = costmap.geometry
    assume(costmap.cells[start] != LETHAL)
    open_at_start = costmap.cells[start] < INSCRIBED
    try:
        path = path_between(planner, costmap, *ends)
    except NoPathError:
        return
    costs = [costmap.cells[place.row_of(y), place.col_of(x)] for x, y, _ in path]
    assert max(costs) < (INSCRIBED if open_at_start else LETHAL)
    assert np.hypot(*np.diff(path[:, :2], axis=0).T).max(initial=0.0) < 0.2


@alike
@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.02, 0.2))
def test_particles_in_more_places_are_never_fewer_after_resampling(
    first: int, second: int, error: float
) -> None:
    few, many = sorted((first, second))
    assert resampled(few, error) <= resampled(many, error)


def resampled(places: int, error: float) -> int:
    """Returns how many of 3000 particles remain if they are spread evenly over ``places`` points a metre apart."""
    config = AmclConfig(kld_err=error, min_particles=10, max_particles=3000)
    particles = ParticleFilter(config, np.random.default_rng(1))
    poses = np.zeros((3000, 3))
    poses[:, 0] = np.arange(3000) % places + 0.25
    particles.replace(poses)
    particles.resample(lambda count: np.zeros((count, 3)))
    return len(particles.poses)
