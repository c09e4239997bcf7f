"""Particles follow the odometry, with noise that grows with the movement."""

import math

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.localisation.config import ODOM_MODELS
from nav_bundle.localisation.motion_model import Alphas, motion_model

QUIET: Alphas = (0.0, 0.0, 0.0, 0.0, 0.0)


def moved(
    name: str, alphas: Alphas, before: Pose, after: Pose, start: Pose, count: int = 1
) -> np.ndarray:
    particles = np.tile([start.x, start.y, start.yaw], (count, 1))
    motion_model(name, alphas)(particles, before, after, np.random.default_rng(3))
    return particles


@pytest.mark.parametrize("name", ODOM_MODELS)
@pytest.mark.parametrize(
    "step", [Pose(0.3, 0.0, 0.2), Pose(-0.3, 0.01, 0.0), Pose(0.0, 0.0, 1.0), Pose(0.1, 0.1, -3.0)]
)
def test_without_noise_particles_repeat_the_step(name: str, step: Pose) -> None:
    before, start = Pose(4.0, 5.0, 0.7), Pose(-1.0, 2.0, -2.0)
    (result,) = moved(name, QUIET, before, before.compose(step), start)
    expected = start.compose(step)
    assert np.allclose(result[:2], [expected.x, expected.y])
    assert abs(math.remainder(result[2] - expected.yaw, math.tau)) < 1e-9


@pytest.mark.parametrize("name", ODOM_MODELS)
def test_noise_grows_with_the_step_and_is_none_at_rest(name: str) -> None:
    alphas = (0.2, 0.2, 0.2, 0.2, 0.2)
    spreads = [
        moved(name, alphas, Pose(), Pose(length, 0.0, 0.0), Pose(), 4000).std(axis=0)
        for length in (0.0, 0.5, 1.0)
    ]
    assert np.allclose(spreads[0], 0.0, atol=1e-12)
    assert (spreads[2] > 1.5 * spreads[1]).all()


def test_the_plain_models_take_variance_for_deviation() -> None:
    alphas = (0.0, 0.0, 0.2, 0.0, 0.0)
    plain = moved("diff", alphas, Pose(), Pose(0.5, 0, 0), Pose(), 20000)[:, 0].std()
    corrected = moved("diff-corrected", alphas, Pose(), Pose(0.5, 0, 0), Pose(), 20000)[:, 0].std()
    assert math.isclose(plain, 0.05, rel_tol=0.03)
    assert math.isclose(corrected, math.sqrt(0.05), rel_tol=0.03)


def test_driving_backwards_is_no_noisier_than_forwards() -> None:
    alphas = (0.2, 0.0, 0.0, 0.2, 0.0)
    for length in (0.5, -0.5):
        spread = moved("diff", alphas, Pose(), Pose(length, 0, 0), Pose(), 1000).std(axis=0)
        assert np.allclose(spread, 0.0, atol=1e-12)
