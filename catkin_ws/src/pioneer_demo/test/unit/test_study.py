"""Studies: their runs, figures and statistics."""

import itertools
import json
import math

import numpy as np
import pytest
from scipy import stats

from pioneer_demo.error import OptionError
from pioneer_demo.scenario.option import Machine
from pioneer_demo.scenario.scenario_file import scenario_folder, scenario_of
from pioneer_demo.study.comparison import (
    frame_of,
    median_interval,
    rate,
    rate_difference,
    summary_of,
)
from pioneer_demo.study.option import experiment_config
from pioneer_demo.study.study import Run, Study, merged, row_of, time_left
from pioneer_node.adapters.document import read_content, read_document


def test_the_shipped_study_changes_the_local_planner():
    study = read_document(Study, scenario_folder() / "study" / "head_on_planners.yaml")
    path = scenario_folder() / "study" / study.scenario
    content, lines = read_content(path)
    plain, dwa = (
        scenario_of(merged(content, change), path, lines) for change in study.variants.values()
    )
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
    assert runs[1].name == "b b-5"


def test_variants_of_similar_names_have_runs_of_their_own():
    variants: dict[str, dict[str, object]] = {
        name: {} for name in ["fast mode", "fast_mode", "fast-mode", "fast", "fast-1", "1"]
    }
    names = [
        run.name
        for run in Study(scenario="s", runs=120, first_seed=0, variants=variants).all_runs()
    ]
    assert len(set(names)) == len(names)


def test_the_time_left_comes_from_the_runs_that_have_ended_with_its_spread():
    assert time_left([], 10, 2) == "time left unknown"
    assert time_left([60.0], 10, 2) == "about 5 min left"
    assert time_left([60.0, 60.0], 1, 4) == "about 1 min left (1 … 1)"
    assert time_left([30.0, 90.0, 60.0, 60.0], 20, 2) == "about 10 min left (6 … 14)"


def test_a_variant_changes_inside_mappings_and_replaces_the_rest():
    content = {"world": "w", "parameters": {"a": 1, "b": 2}, "robots": [1, 2]}
    change = {"parameters": {"b": 3}, "robots": [4], "seed": 2}
    assert merged(content, change) == {
        "world": "w",
        "parameters": {"a": 1, "b": 3},
        "robots": [4],
        "seed": 2,
    }


def robot(seconds, reached=3, path=10.0, way=8.0):
    """Returns a robot's entry in a report; ``seconds`` is None if it is stuck."""
    visits = [{"shortest_way": way / 2}, {"shortest_way": way / 2}]
    return {
        "waypoints": 3,
        "reached": reached,
        "seconds": seconds,
        "path_length": path,
        "visits": visits,
    }


def test_a_row_has_what_the_report_has_and_none_for_the_rest():
    one = robot(30.0) | {"collisions": 0, "localisation_error": {"mean": 0.02}}
    other = robot(40.0, path=20.0) | {"collisions": 1, "localisation_error": {"mean": None}}
    report = {
        "success": False,
        "robots": {"a": one, "b": other},
        "faults": ["x", "y"],
        "drive": {"bytes": 9},
    }
    row = row_of(Run("a", 1), report, 12.34)
    assert (row["finished"], row["success"]) == (True, False)
    assert (row["seconds"], row["path_length"], row["collisions"]) == (40.0, 15.0, 1)
    assert (row["missed"], row["bytes"], row["messages"]) == (0, 9, None)
    assert (row["localisation_error"], row["closest_approach"], row["faults"]) == (
        0.02,
        None,
        "x; y",
    )
    assert row["spl"] == pytest.approx((8 / 10 + 8 / 20) / 2)


@pytest.mark.parametrize(
    "failed", [robot(None, reached=1, path=2.0), robot(5.0, reached=1, path=2.0)]
)
def test_a_run_in_which_a_robot_fails_has_no_time_and_no_path_to_win_with(failed):
    """The one robot is stuck; the other has given up its last waypoints."""
    report = {
        "robots": {"a": robot(30.0), "b": failed},
        "drive": {"bytes": 9, "messages": 1, "closest_approach": 0.4},
    }
    row = row_of(Run("a", 1), report, 1.0)
    assert not row["finished"]
    assert [row[name] for name in ("seconds", "path_length", "messages", "bytes")] == 4 * [None]
    assert (row["missed"], row["closest_approach"]) == (2, 0.4)
    assert row["spl"] == pytest.approx(0.4), "the robot that failed counts as 0"


def test_a_report_of_another_program_may_leave_out_waypoints_and_ways():
    row = row_of(Run("a", 1), {"robots": {"a": {"seconds": 3.0, "path_length": 1.0}}}, 1.0)
    assert (row["seconds"], row["path_length"], row["spl"]) == (3.0, 1.0, None)
    assert row_of(Run("a", 1), {"robots": {"a": {}}}, 1.0)["seconds"] is None


def rows_of(variant, times):
    """Returns rows of runs with these times; None is a run without an end."""
    return [
        row_of(
            Run(variant, seed),
            {"success": time is not None, "robots": {"a": robot(time, 1 + 2 * (time is not None))}},
            1.0,
        )
        for seed, time in enumerate(times)
    ]


def test_a_variant_that_gives_up_early_does_not_win():
    rows = rows_of("slow", 20 * [90.0]) + rows_of("stuck", [*5 * [90.0], *15 * [None]])
    slow, stuck = summary_of(frame_of(rows, ["slow", "stuck"]))["variants"].values()
    assert (slow["success"]["rate"], stuck["success"]["rate"]) == (1.0, 0.25)
    assert stuck["metrics"]["seconds"] == {
        "count": 5, "unfinished": 15, "mean": 90.0, "median": None, "low": None, "high": None
    }  # fmt: skip
    gap = stuck["difference"]["seconds"]
    assert (gap["count"], gap["unfinished"], gap["median"]) == (5, 15, None)
    assert stuck["metrics"]["spl"]["mean"] == pytest.approx(0.25 * slow["metrics"]["spl"]["mean"])
    assert stuck["difference"]["success"]["high"] < 0.0
    json.dumps(stuck, allow_nan=False)


def test_fewer_values_than_six_get_no_interval():
    for count in range(1, 9):
        rows = rows_of("a", [10.0 + seed for seed in range(count)])
        figures = summary_of(frame_of(rows, ["a"]))["variants"]["a"]["metrics"]["seconds"]
        assert ("low" in figures) == (count >= 6), count
        assert figures["median"] == pytest.approx(10.0 + (count - 1) / 2)


HALF_NORMAL = 0.6744897501960817
DISTRIBUTIONS = {
    "normal": (lambda rng, n: rng.normal(size=n), 0.0),
    "skewed": (lambda rng, n: rng.lognormal(sigma=1.5, size=n), 1.0),
    "heavy tails": (lambda rng, n: rng.standard_cauchy(size=n), 0.0),
    "near a bound": (lambda rng, n: abs(rng.normal(size=n)), HALF_NORMAL),
    "counts": (lambda rng, n: rng.poisson(0.5, size=n).astype(float), 0.0),
    "a third unfinished": (
        lambda rng, n: np.where(rng.uniform(size=n) < 1 / 3, np.inf, rng.uniform(size=n)), 0.75
    ),
}  # fmt: skip
"""Distributions of a metric, each with its true median."""


@pytest.mark.parametrize("name", DISTRIBUTIONS)
@pytest.mark.parametrize("count", [6, 7, 10, 25])
def test_the_interval_of_a_median_covers_it_in_95_percent_of_all_studies(name, count):
    draw, truth = DISTRIBUTIONS[name]
    rng = np.random.default_rng(count)
    trials = 400
    covered = 0
    for _ in range(trials):
        low, high = median_interval(draw(rng, count))
        covered += low <= truth <= high
    # Three standard deviations of the simulation itself.
    assert covered / trials >= 0.95 - 3 * math.sqrt(0.95 * 0.05 / trials)


@pytest.mark.parametrize("count", [1, 2, 5, 10, 30])
def test_the_interval_of_a_rate_covers_it_in_95_percent_of_all_studies(count):
    """Summed over all outcomes, not drawn."""
    bounds = [rate(successes, count) for successes in range(count + 1)]
    for truth in np.linspace(0.005, 0.995, 100):
        chances = stats.binom.pmf(range(count + 1), count, truth)
        covered = sum(
            chance
            for chance, found in zip(chances, bounds, strict=True)
            if found["low"] <= truth <= found["high"]
        )
        assert covered >= 0.95


@pytest.mark.parametrize("count", [1, 3, 10, 20])
def test_the_interval_of_a_difference_of_rates_covers_it_in_95_percent_of_all_studies(count):
    """Summed over all outcomes, not drawn: pairs in which only one variant, only the other, or neither differs."""
    outcomes = [(gained, lost) for gained in range(count + 1) for lost in range(count + 1 - gained)]
    bounds = [rate_difference(gained, lost, count) for gained, lost in outcomes]
    low = np.array([found["low"] for found in bounds])
    high = np.array([found["high"] for found in bounds])
    counts = np.array([(gained, lost, count - gained - lost) for gained, lost in outcomes])
    shares = (0.0, 0.02, 0.1, 0.3, 0.5, 0.85)
    for gain, loss in itertools.product(shares, shares):
        if gain + loss > 1.0:
            continue
        chances = stats.multinomial.pmf(counts, count, [gain, loss, 1.0 - gain - loss])
        assert chances[(low <= gain - loss) & (gain - loss <= high)].sum() >= 0.95


def test_differences_are_paired_by_seed_so_that_hard_seeds_cancel():
    rng, rows = np.random.default_rng(3), []
    for seed in range(30):
        hard = float(rng.uniform(0.0, 100.0))
        for variant, gain in (("a", 0.0), ("b", -5.0)):
            report = {
                "success": True,
                "robots": {"r": robot(50.0 + hard + gain + float(rng.normal()))},
            }
            rows.append(row_of(Run(variant, seed), report, 1.0))
    summary = summary_of(frame_of(rows, ["a", "b"]))
    gap = summary["variants"]["b"]["difference"]["seconds"]
    assert gap["low"] < -4.4 < gap["mean"] + 1.0
    assert gap["high"] < -3.5
    assert gap["count"] == 30
    assert summary == summary_of(frame_of(rows, ["a", "b"])), (
        "the same rows give the same intervals"
    )
    assert summary["variants"]["a"]["success"]["low"] == pytest.approx(0.884, abs=1e-3)
