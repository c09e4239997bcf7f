"""The parameter manual of slam_gmapping names every parameter with its default."""

import dataclasses
from pathlib import Path

import yaml

from nav_bundle.mapping.config import GmappingConfig
from pioneer_node.core.parameter import config_from_mapping

CONFIG = Path(__file__).parents[2] / "config"


def test_the_manual_holds_every_default() -> None:
    assert yaml.safe_load((CONFIG / "gmapping_defaults.yaml").read_text()) == dataclasses.asdict(
        GmappingConfig()
    )


def test_the_pioneers_parameters_are_valid() -> None:
    values = yaml.safe_load((CONFIG / "gmapping_pioneer.yaml").read_text())
    assert config_from_mapping(GmappingConfig, values, "slam_gmapping").linearUpdate == 0.3
