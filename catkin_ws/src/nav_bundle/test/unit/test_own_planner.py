"""Planners and recovery behaviours of other packages, named by their class, and the contract that they are held to."""

import sys
from pathlib import Path

import pytest

from nav_bundle.check_planner import main
from nav_bundle.move_base.config import setup_from_parameters
from pioneer_node.core.parameter import ParameterError

OWN = """
from dataclasses import dataclass
import numpy as np
from nav_bundle.control.dwa_planner import DwaPlanner
from nav_bundle.control.dwa_config import DwaConfig
from nav_bundle.planning.navfn import NavfnConfig, NavfnPlanner

class Global(NavfnPlanner):
    Config = NavfnConfig

class Local(DwaPlanner):
    Config = DwaConfig

class Plain:
    def __init__(self, parameters, resolution):
        self.parameters = parameters
    def set_plan(self, plan): pass
    def decide(self, situation): raise ValueError("lost")
    def cell_costs(self): return np.empty((0, 6))

class Wait:
    limit = None
    def __init__(self, name, parameters):
        self.name, self.complaint, self.parameters = name, "", parameters
    def start(self): pass
    def step(self, around): return None

class Nothing: pass
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "own_planners.py").write_text(OWN)
    (tmp_path / "broken_planners.py").write_text("import nowhere_to_be_found\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "own_planners", raising=False)
    return "own_planners"


def test_planners_and_recoveries_may_be_classes_of_any_package(own: str) -> None:
    setup = setup_from_parameters(
        {
            "base_global_planner": f"{own}.Global",
            "base_local_planner": f"{own}.Plain",
            "recovery_behaviors": [{"name": "wait", "type": f"{own}.Wait"}],
            "Global": {"default_tolerance": 0.5},
            "Plain": {"gain": 2.0},
            "wait": {"time": 3.0},
        },
        "move_base",
    )
    assert type(setup.make_global_planner()).__name__ == "Global"
    assert setup.global_planner.default_tolerance == 0.5
    assert setup.make_local_planner().parameters == {"gain": 2.0}  # type: ignore[attr-defined]
    assert setup.recoveries[0].parameters == {"time": 3.0}  # type: ignore[attr-defined]
    assert setup.live_configs().keys() >= {"", "local_costmap"}


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"base_local_planner": "own_planners.Missing"}, "own_planners has no class Missing"),
        ({"base_local_planner": "nobody.has.This"}, "importing nobody.has fails"),
        ({"base_global_planner": "broken_planners.Any"}, "nowhere_to_be_found"),
        (
            {"base_local_planner": "teb_local_planner/TebLocalPlannerROS"},
            "there are base_local_planner/TrajectoryPlannerROS",
        ),
        ({"recovery_behaviors": [{"name": "x", "type": "own_planners.No"}]}, "has no class No"),
    ],
)
def test_a_class_that_cannot_be_loaded_is_named_with_the_reason(
    own: str, parameters: dict[str, object], words: str
) -> None:
    with pytest.raises(ParameterError, match=words):
        setup_from_parameters(parameters, "move_base")


@pytest.mark.parametrize("name", ["Global", "Local"])
def test_planners_that_keep_the_contract_pass(
    own: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([f"{own}.{name}"]) == 0, capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Plain", "FAILED a robot follows a plan to its goal without contact: ValueError: lost"),
        ("Nothing", "Nothing is no planner"),
    ],
)
def test_others_fail_with_the_reason(
    own: str, name: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([f"{own}.{name}"]) == 1
    said = capsys.readouterr()
    assert words in said.out + said.err
