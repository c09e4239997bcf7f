"""``bench compare``: it marks a broken subject, and only that, on a faster and on a slower machine."""

import argparse
import json
import random
from pathlib import Path
from typing import Any

import pytest

from pioneer_bench import compare, report
from pioneer_bench.core.comparison import Change, changes
from pioneer_bench.core.row import Row
from pioneer_bench.speed import measured

MACHINE = {"python": 0.01, "kernel": 0.02, "socket": 0.03}


def report_of(rows: list[Row], slower: float = 1.0, drift: float = 1.0) -> dict[str, Any]:
    """Returns a report of a machine that takes ``slower`` times as long, and ``drift`` times longer at the end."""
    before = {name: time * slower for name, time in MACHINE.items()}
    after = {name: time * drift for name, time in before.items()}
    return {"machine": {"before": before, "after": after}, "rows": [row.as_dict() for row in rows]}


def judged(old: Row, new: Row, slower: float = 1.0, drift: float = 1.0) -> Change:
    (found,) = changes(report_of([old]), report_of([new], slower, drift))
    return found


@pytest.mark.parametrize(
    ("unit", "old", "new", "slower", "judgement"),
    [
        ("CPU-s/sim-s", 0.10, 0.20, 2.0, ""),
        ("CPU-s/sim-s", 0.10, 0.11, 1.0, "worse"),
        ("CPU-s/sim-s", 0.10, 0.10, 0.5, "worse"),
        ("CPU-s/sim-s", 0.10, 0.09, 1.0, "better"),
        ("MB/CPU-s", 700.0, 350.0, 2.0, ""),
        ("MB/CPU-s", 700.0, 600.0, 1.0, "worse"),
        ("ms", 0.3, 0.6, 2.0, ""),
        ("msg/s", 9000.0, 8000.0, 1.0, "worse"),
        ("MB", 50.0, 60.0, 2.0, "worse"),
        ("m", 3.0, 4.0, 1.0, "changed"),
    ],
)
def test_a_figure_is_judged_with_the_machine_s_speed_taken_out(
    unit: str, old: float, new: float, slower: float, judgement: str
) -> None:
    assert judged(Row("x", unit, (old,)), Row("x", unit, (new,)), slower).judgement == judgement


def test_a_goal_says_which_way_a_figure_should_go() -> None:
    assert (
        judged(Row("x", "m", (0.3,), 0.2, at_least=True), Row("x", "m", (0.2,), 0.2)).judgement
        == "worse"
    )
    assert judged(Row("x", "m", (0.3,), 0.5), Row("x", "m", (0.2,), 0.5)).judgement == "better"


def test_a_change_within_the_spread_of_the_samples_or_of_the_machine_is_noise() -> None:
    steady, shaky = Row("x", "MB", (10.0, 10.0, 10.0)), Row("x", "MB", (9.0, 11.0, 13.0))
    assert judged(steady, shaky).judgement == ""
    assert judged(Row("x", "CPU-s", (1.0,)), Row("x", "CPU-s", (1.3,)), drift=1.4).judgement == ""


def test_random_machines_hide_no_broken_subject_and_invent_none() -> None:
    source = random.Random(34)
    for _ in range(500):
        slower = source.uniform(0.3, 3.0)
        cost = source.uniform(0.01, 5.0)
        broken = source.random() < 0.5
        factor = source.uniform(1.1, 3.0) if broken else 1.0
        change = judged(
            Row("x", "CPU ms", (cost,)), Row("x", "CPU ms", (cost * slower * factor,)), slower
        )
        assert change.judgement == ("worse" if broken else "")


def test_reports_of_the_simulator_are_compared_run_by_run() -> None:
    run = {"robots": 5, "cost": 0.05, "first_step": 0.8, "rss": 100.0}
    old = {**report_of([]), "fleet": [run]}
    new = {**report_of([]), "fleet": [{**run, "cost": 0.08}]}
    found = {change.name: change.judgement for change in changes(old, new)}
    assert found == {
        "fleet, 5 robots: cost": "worse",
        "fleet, 5 robots: first step": "",
        "fleet, 5 robots: memory": "",
    }


def compared(folder: Path, old: object, new: object) -> int:
    for name, content in (("old", old), ("new", new)):
        (folder / f"{name}.json").write_text(
            content if isinstance(content, str) else json.dumps(content)
        )
    return compare.run(argparse.Namespace(old=folder / "old.json", new=folder / "new.json"))


def test_the_command_ends_with_1_if_something_is_worse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = report_of([Row("x", "MB", (10.0,))]), report_of([Row("x", "MB", (20.0,))])
    assert compared(tmp_path, good, good) == 0
    assert compared(tmp_path, good, bad) == 1
    assert "1 figures: 1 worse, 0 better, 0 changed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "says"),
    [
        ({"rows": []}, "does not carry the machine's speed: run the bench again"),
        ("nothing", "is not JSON"),
        ([], "is not the report of a bench"),
        (report_of([Row("y", "MB", (1.0,))]), "have no figure in common"),
    ],
)
def test_a_report_that_cannot_be_compared_is_named_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: object, says: str
) -> None:
    assert compared(tmp_path, old, report_of([Row("x", "MB", (1.0,))])) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_report_carries_the_machine_s_speed_before_and_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "_speed_before", [])
    report.begin()
    options = argparse.Namespace(output=tmp_path)
    report.finish(options, "speed", "Speed", [Row("a", "CPU-s", (1.0,))])
    content = json.loads((tmp_path / "speed.json").read_text())
    assert changes(content, content)[0].ratio == 1.0


def test_every_part_of_the_machine_s_speed_takes_time() -> None:
    speed = measured()
    assert min(speed.as_dict().values()) > 0.0
