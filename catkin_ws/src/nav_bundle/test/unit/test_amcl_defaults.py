"""The parameter manual names every parameter with its default."""

import dataclasses
from pathlib import Path

import pytest
import yaml

from nav_bundle.localisation.config import AmclConfig

CONFIG = Path(__file__).parents[2] / "config"
ORIGINALS = {
    "use_map_topic": True, "odom_model_type": "diff", "gui_publish_rate": 10.0,
    "odom_alpha1": 0.2, "odom_alpha2": 0.2, "odom_alpha3": 0.2, "odom_alpha4": 0.2, "odom_alpha5": 0.1,
    "laser_max_beams": 60, "laser_max_range": 12.0, "min_particles": 500, "max_particles": 2000,
    "kld_err": 0.05, "kld_z": 0.99, "laser_z_hit": 0.5, "laser_z_short": 0.05, "laser_z_max": 0.05, "laser_z_rand": 0.5,
    "laser_sigma_hit": 0.2, "laser_lambda_short": 0.1, "laser_model_type": "likelihood_field",
    "laser_likelihood_max_dist": 2.0, "update_min_d": 0.25, "update_min_a": 0.2, "resample_interval": 1,
    "transform_tolerance": 1.0, "recovery_alpha_slow": 0.0, "recovery_alpha_fast": 0.0,
}  # fmt: skip
"""What the tutorial's amcl_pioneer.launch gave."""


def test_the_manual_holds_every_default() -> None:
    written = yaml.safe_load((CONFIG / "amcl_defaults.yaml").read_text())
    assert written == pytest.approx(dataclasses.asdict(AmclConfig()), abs=1e-3)


def test_the_pioneers_amcl_is_the_originals() -> None:
    written = yaml.safe_load((CONFIG / "amcl_pioneer.yaml").read_text())
    assert {name: written[name] for name in ORIGINALS} == ORIGINALS
