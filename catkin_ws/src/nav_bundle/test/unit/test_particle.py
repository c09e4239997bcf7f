"""Particles are resampled by weight, as many as their spread requires, and the estimate is their heaviest cluster."""

import math

import numpy as np
import pytest
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.particle_filter import FreeSpace, ParticleFilter
from pioneer_node.core.parameter import ParameterError

CONFIG = AmclConfig(min_particles=200, max_particles=4000, kld_err=0.05)


def nowhere(count: int) -> np.ndarray:
    raise AssertionError("no random pose was due")


def a_filter(config: AmclConfig = CONFIG) -> ParticleFilter:
    return ParticleFilter(config, np.random.default_rng(1))


def test_particles_gather_with_the_covariance_asked_for() -> None:
    particles = a_filter()
    covariance = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.05]])
    particles.gather(Pose(3.0, -2.0, 1.0), covariance)
    assert np.allclose(np.cov(particles.poses.T), covariance, atol=0.02)
    estimate = particles.estimate()
    assert np.allclose(estimate.covariance, covariance, atol=0.02)
    assert math.hypot(estimate.pose.x - 3, estimate.pose.y + 2) < 0.05
    assert abs(estimate.pose.yaw - 1) < 0.02


def test_heavy_particles_are_drawn_and_weightless_ones_are_not() -> None:
    particles = a_filter()
    particles.replace(np.array([[0.0, 0, 0], [5.0, 0, 0], [9.0, 0, 0]]))
    particles.weigh(np.array([1.0, 3.0, 0.0]))
    particles.resample(nowhere)
    xs, counts = np.unique(particles.poses[:, 0], return_counts=True)
    assert xs.tolist() == [0.0, 5.0]
    assert abs(counts[1] / counts.sum() - 0.75) < 0.1
    assert math.isclose(particles.weights.sum(), 1.0)


def test_a_wide_spread_keeps_more_particles_than_a_narrow_one() -> None:
    sizes = []
    for sigma in (0.01, 0.5, 5.0, 50.0):
        particles = a_filter()
        particles.gather(Pose(), np.eye(3) * sigma**2)
        particles.resample(nowhere)
        sizes.append(len(particles.poses))
    assert sizes[0] == CONFIG.min_particles
    assert sizes == sorted(sizes)
    assert sizes[-1] == CONFIG.max_particles


def test_the_heaviest_cluster_is_the_estimate() -> None:
    particles = a_filter()
    near = np.random.default_rng(2).normal([1.0, 1.0, 0.0], 0.05, (100, 3))
    far = np.random.default_rng(3).normal([8.0, 8.0, 2.0], 0.05, (60, 3))
    particles.replace(np.vstack([near, far]))
    estimate = particles.estimate()
    assert type(estimate.pose.x) is float  # the parameter server does not accept numpy floats
    assert estimate.pose.distance(Pose(1, 1)) < 0.05
    assert math.isclose(estimate.weight, 100 / 160)
    particles.weigh(np.array([1.0] * 100 + [4.0] * 60))
    assert particles.estimate().pose.distance(Pose(8, 8)) < 0.05


def test_a_cluster_spans_the_turn_of_heading() -> None:
    particles = a_filter()
    headings = math.pi + np.linspace(-0.3, 0.3, 101)
    particles.replace(np.column_stack([np.zeros((101, 2)), headings]))
    estimate = particles.estimate()
    assert math.isclose(estimate.weight, 1.0)
    assert abs(math.remainder(estimate.pose.yaw - math.pi, math.tau)) < 1e-6
    assert math.isclose(estimate.covariance[2, 2], headings.var(), rel_tol=0.05)


def test_weights_that_vanish_leave_the_particles_equal() -> None:
    particles = a_filter()
    particles.replace(np.zeros((4, 3)))
    particles.weigh(np.zeros(4))
    assert particles.weights.tolist() == [0.25] * 4


@pytest.mark.parametrize(("likelihood", "expected"), [(10.0, 0.0), (9.4, 0.03), (1.0, 0.1)])
def test_a_fall_in_likelihood_adds_random_particles_up_to_a_tenth(
    likelihood: float, expected: float
) -> None:
    config = AmclConfig(
        min_particles=4000, max_particles=4000, recovery_alpha_slow=0.001, recovery_alpha_fast=0.5
    )
    particles = a_filter(config)
    particles.replace(np.zeros((400, 3)))
    particles.weigh(np.full(400, 10.0))
    particles.weigh(np.full(400, likelihood))
    particles.resample(lambda count: np.full((count, 3), 7.0))
    share = np.mean(particles.poses[:, 0] == 7.0)
    assert abs(share - expected) < 0.01


def test_the_particles_of_a_place_are_as_many_as_its_weight_says() -> None:
    particles = a_filter(AmclConfig(min_particles=1000, max_particles=1000))
    for _ in range(100):
        particles.replace(np.repeat([[0.0, 0, 0], [5.0, 0, 0]], 500, axis=0))
        particles.weigh(np.repeat([0.994, 0.006], 500))
        particles.resample(nowhere)
        assert abs(np.count_nonzero(particles.poses[:, 0]) - 6) <= 2


def test_selective_resampling_keeps_particles_that_are_still_even() -> None:
    particles = a_filter(AmclConfig(selective_resampling=True))
    particles.gather(Pose(), np.eye(3))
    before = particles.poses.copy()
    particles.weigh(np.full(len(before), 2.0))
    particles.resample(nowhere)
    assert (particles.poses == before).all()


def test_the_likeliest_of_some_random_poses_is_taken() -> None:
    space = FreeSpace(grid_from_text(["." * 20], 1.0), np.random.default_rng(5))
    xs = space.draw_likely(500, 9, lambda poses: poses[:, 0])[:, 0]
    assert abs(xs.mean() - 20.0 * 9 / 10) < 0.3  # the mean of the maximum of nine draws


def test_random_poses_lie_in_free_cells_evenly() -> None:
    grid = grid_from_text(["#..?", "?#.#"], 0.5, Pose(2.0, -1.0, 0.4))
    poses = FreeSpace(grid, np.random.default_rng(5)).draw(3000)
    cells = grid.cells_at(poses[:, :2])
    assert (grid.cells[cells[:, 0], cells[:, 1]] == 0).all()
    counts = np.unique(cells, axis=0, return_counts=True)[1]
    assert len(counts) == 3
    assert counts.min() > 900
    assert abs(poses[:, 2].mean()) < 0.2


@pytest.mark.parametrize(
    "values",
    [
        {"odom_model_type": "legs"},
        {"laser_model_type": "sonar"},
        {"min_particles": 0},
        {"max_particles": 10},
        {"laser_max_beams": 1},
        {"kld_err": 0.0},
        {"odom_alpha3": -0.1},
        {"seed": -1},
        {"initial_pose_x": math.nan},
    ],
)
def test_a_parameter_out_of_range_is_refused_by_name(values: dict[str, object]) -> None:
    with pytest.raises(ParameterError, match=f"amcl: parameter ~{next(iter(values))} must"):
        AmclConfig(**values)  # type: ignore[arg-type]
