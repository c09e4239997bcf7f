"""The output of a bench: a table, the same data as JSON, and an exit status; and the effect of its options."""

import argparse
import json
from pathlib import Path

import pytest

from pioneer_bench import lockstep, sim
from pioneer_bench.core.row import Row, markdown
from pioneer_bench.core.simulator import SETTINGS
from pioneer_bench.report import finish

NO_CHANGES = {
    "robots": None,
    "beams": None,
    "scan_rate": None,
    "odometry_rate": None,
    "real_time_factor": None,
}


@pytest.mark.parametrize(("sample", "status"), [(1.0, 0), (2.0, 1)])
def test_table_json_and_exit_status_say_whether_goals_hold(
    tmp_path: Path, sample: float, status: int
) -> None:
    options = argparse.Namespace(output=tmp_path / "new")
    assert (
        finish(options, "speed", "Speed", [Row("a", "s", (sample,), 1.5)], "A remark.", seed=3)
        == status
    )
    values = json.loads((tmp_path / "new" / "speed.json").read_text())
    assert (values["seed"], values["rows"][0]["holds"]) == (3, status == 0)
    text = (tmp_path / "new" / "speed.md").read_text()
    assert text.startswith("# Speed\n\n| what")
    assert text.endswith("A remark.\n")


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    assert (
        markdown([("name", "n"), ("a", "100")]) == "| name | n   |\n|------|-----|\n| a    | 100 |"
    )
    assert markdown([("n",), ("100",)], right=True) == "|   n |\n|----:|\n| 100 |"


def test_a_changed_setting_of_the_simulator_is_held_against_nobody() -> None:
    fleet = SETTINGS["fleet"]
    assert sim._rates(fleet, argparse.Namespace(**NO_CHANGES)) == fleet
    fewer = sim._rates(fleet, argparse.Namespace(**{**NO_CHANGES, "robots": [3]}))
    assert (fewer.robots, fewer.goals) == ([3], fleet.goals)
    changed = sim._rates(fleet, argparse.Namespace(**{**NO_CHANGES, "beams": 90}))
    assert (changed.beams, changed.goals, changed.peers, changed.peer) == (90, {}, {}, "")
    assert "90" in changed.title


def lockstep_rows(*results: bytes, missed: int = 0) -> dict[str, bool | None]:
    costs = {
        "real_time_factor": 2.0,
        "cpu_seconds_per_simulated_second": 0.5,
        "stale": 0,
        "missed": missed,
    }
    rows = lockstep._rows(2, [{**costs, "bytes": result} for result in results])
    return {row.what.removeprefix("2 robots: "): row.holds for row in rows}


def test_demos_of_one_seed_must_leave_the_same_bytes_and_miss_nothing() -> None:
    assert lockstep_rows(b"same", b"same")["different results of one seed"]
    assert lockstep_rows(b"same", b"other")["different results of one seed"] is False
    assert "different results of one seed" not in lockstep_rows(b"alone")
    assert lockstep_rows(b"alone", missed=1)["waypoints missed"] is False
    assert lockstep_rows(b"alone")["real-time factor"] is False
