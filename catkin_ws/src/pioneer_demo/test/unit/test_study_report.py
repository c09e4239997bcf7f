"""The page of a study."""

import re
from pathlib import Path

import numpy as np
import pytest

from pioneer_demo.study.report import _interval, write_report
from pioneer_demo.study.study import Run, Study, row_of


@pytest.fixture
def page(tmp_path: Path) -> str:
    """Returns the page of a study in which b is 5 s faster, and one of its ten runs is stuck."""
    rng = np.random.default_rng(1)
    rows = []
    for seed in range(10):
        hard = rng.uniform(0.0, 20.0)
        for variant, gain in (("a", 0.0), ("b", -5.0)):
            stuck = variant == "b" and seed == 3
            robot = {
                "waypoints": 2,
                "reached": 2 - stuck,
                "seconds": None if stuck else 60.0 + hard + gain + rng.normal(),
                "path_length": 12.0,
                "collisions": 0,
                "visits": [{"shortest_way": 11.0}],
            }
            report = {
                "success": not stuck,
                "robots": {"r": robot},
                "faults": ["stuck <here>"] if stuck else [],
            }
            rows.append(row_of(Run(variant, seed), report, 1.0))
    study = Study(scenario="s", about="Which & why?", variants={"a": {}, "b": {}})
    write_report(study, rows, tmp_path, "meetings", "./pioneer experiment meetings.yaml --runs 10")
    return (tmp_path / "report.html").read_text()


def test_a_page_has_the_studys_name_data_and_command(page: str) -> None:
    assert "<title>meetings</title>" in page
    assert "Which &amp; why?" in page
    assert "stuck &lt;here&gt;" in page
    assert '<a href="runs.csv">' in page
    assert "<code>./pioneer experiment meetings.yaml --runs 10</code>" in page
    assert page.count("<svg") == 2, "the forest plot, and the distributions"


def test_a_page_counts_runs_without_an_end_and_draws_nothing_that_is_constant(page: str) -> None:
    assert "n = 9 of 10" in page
    assert "90 % (55 … 100)" in page
    figures = page[page.index("<h2>Figures") :]
    assert "time until all are done" in figures
    assert "collisions, all robots" not in figures


@pytest.mark.parametrize(
    ("median", "low", "high", "sign", "text"),
    [
        (243.4567, 240.123, 247.456, "", "243.5 (240.1 … 247.5)"),
        (0.017123, 0.016911, 0.017441, "", "0.01712 (0.01691 … 0.01744)"),
        (-4.9, -5.3, -4.4, "+", "−4.90 (−5.30 … −4.40)"),
        (12345.6, 11000.0, 14000.0, "", "12346 (11000 … 14000)"),
        (90.0, 80.0, None, "", "90.0 (80.0 … ∞)"),
        (None, None, None, "+", "∞ (−∞ … ∞)"),
        (0.0, 0.0, 0.0, "", "0 (0 … 0)"),
    ],
)
def test_values_have_the_digits_that_their_interval_leaves(
    median: float | None, low: float | None, high: float | None, sign: str, text: str
) -> None:
    assert _interval({"count": 9, "median": median, "low": low, "high": high}, sign) == text


def test_columns_are_sorted_by_a_click(page: str) -> None:
    assert re.search(r"querySelectorAll\(\"th\"\)\) head.onclick", page)
