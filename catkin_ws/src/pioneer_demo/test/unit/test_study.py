"""Studies: their runs, figures and statistics."""

import numpy as np
import pytest

from pioneer_demo.adapters.scenario_file import scenario_folder, scenario_of
from pioneer_demo.core.comparison import frame_of, summary_of
from pioneer_demo.core.error import OptionError
from pioneer_demo.core.option import Machine
from pioneer_demo.core.study import Run, Study, merged, row_of
from pioneer_demo.core.study_option import experiment_config
from pioneer_node.adapters.document import read_content, read_document


def test_the_shipped_study_changes_the_local_planner():
    study = read_document(Study, scenario_folder() / "study" / "head_on_planners.yaml")
    path = scenario_folder() / "study" / study.scenario
    content, lines = read_content(path)
    plain, dwa = (scenario_of(merged(content, change), path, lines) for change in study.variants.values())
    assert (plain.navigation, plain.parameters) == ("", {})
    assert dwa.navigation.endswith("dwa_local_planner_params.yaml")
    assert dwa.parameters["move_base/base_local_planner"] == "dwa_local_planner/DWAPlannerROS"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--jobs", "0"], "--jobs must be 1 to 1000, not 0"),
        (["--jobs", "99999999999"], "--jobs must be 1 to 1000, not 99999999999"),
        (["--runs", "-2"], "--runs must be 0 (as in the file) or more, not -2"),
    ],
)
def test_a_number_of_jobs_or_runs_out_of_range_is_refused_by_its_name(words, text):
    with pytest.raises(OptionError) as caught:
        experiment_config(["study.yaml", *words], Machine({}, 0, 2))
    assert str(caught.value) == text


def test_runs_come_seed_by_seed_so_that_an_early_end_still_compares():
    runs = Study(scenario="s", runs=2, first_seed=5, variants={"a": {}, "b b": {}}).all_runs()
    assert runs == [Run("a", 5), Run("b b", 5), Run("a", 6), Run("b b", 6)]
    assert runs[1].name == "b_b-5"


def test_a_variant_changes_inside_mappings_and_replaces_the_rest():
    content = {"world": "w", "parameters": {"a": 1, "b": 2}, "robots": [1, 2]}
    change = {"parameters": {"b": 3}, "robots": [4], "seed": 2}
    assert merged(content, change) == {"world": "w", "parameters": {"a": 1, "b": 3}, "robots": [4], "seed": 2}


def test_a_row_has_what_the_report_has_and_none_for_the_rest():
    robots = {
        "pioneer1": {
            "waypoints": 3,
            "reached": 1,
            "seconds": 30.0,
            "path_length": 10.0,
            "collisions": 0,
            "localisation_error": {"mean": 0.02},
        },
        "pioneer2": {"seconds": 40.0, "path_length": 20.0, "collisions": 1, "localisation_error": {"mean": None}},
    }
    row = row_of(Run("a", 1), {"success": False, "robots": robots, "faults": ["x", "y"], "drive": {"bytes": 9}}, 12.34)
    assert (row["seconds"], row["path_length"], row["collisions"]) == (40.0, 15.0, 1)
    assert (row["missed"], row["bytes"], row["messages"]) == (2, 9, None)
    assert (row["localisation_error"], row["closest_approach"], row["faults"]) == (0.02, None, "x; y")
    robots["pioneer1"]["seconds"] = None
    assert row_of(Run("a", 1), {"robots": robots}, 0.0)["seconds"] is None, "one robot never finished"


def test_differences_are_paired_by_seed_so_that_hard_seeds_cancel():
    rng, rows = np.random.default_rng(3), []
    for seed in range(30):
        hard = float(rng.uniform(0.0, 100.0))
        for variant, gain in (("a", 0.0), ("b", -5.0)):
            report = {"success": True, "robots": {"r": {"seconds": 50.0 + hard + gain + float(rng.normal())}}}
            rows.append(row_of(Run(variant, seed), report, 1.0))
    summary = summary_of(frame_of(rows, ["a", "b"]))
    gap = summary["variants"]["b"]["difference"]["seconds"]
    assert gap["low"] < -4.4 < gap["mean"] + 1.0
    assert gap["high"] < -3.5
    assert gap["count"] == 30
    assert summary == summary_of(frame_of(rows, ["a", "b"])), "the same rows give the same intervals"
    assert summary["variants"]["a"]["success"]["low"] == pytest.approx(0.886, abs=1e-3)
