"""Planners of one's own written for the former places of modules keep working, with a warning."""

import importlib
import sys

import pytest


@pytest.mark.parametrize(
    ("former", "place", "name"),
    [
        ("local_planner", "control.local_planner", "Decision"),
        ("local_planner", "base.velocity", "Velocity"),
        ("planner", "planning.planner", "Path"),
        ("pose", "base.pose", "Pose"),
    ],
)
def test_a_former_place_has_the_same_names_and_warns(former, place, name, monkeypatch):
    monkeypatch.delitem(sys.modules, f"nav_bundle.core.{former}", raising=False)
    with pytest.warns(DeprecationWarning, match=rf"nav_bundle\.core\.{former} is now nav_bundle\."):
        module = importlib.import_module(f"nav_bundle.core.{former}")
    assert getattr(module, name) is getattr(importlib.import_module(f"nav_bundle.{place}"), name)
