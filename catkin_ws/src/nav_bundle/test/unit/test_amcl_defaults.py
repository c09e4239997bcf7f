"""The parameter manual names every parameter with its default."""

import dataclasses
from pathlib import Path

import pytest
import yaml

from nav_bundle.core.amcl_config import AmclConfig


def test_the_manual_holds_every_default() -> None:
    path = Path(__file__).parents[2] / "config" / "amcl_defaults.yaml"
    written = yaml.safe_load(path.read_text())
    assert written == pytest.approx(dataclasses.asdict(AmclConfig()), abs=1e-3)
