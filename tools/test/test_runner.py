"""How ``./pioneer test`` handles its command line, and another run in the same checkout."""

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import checks
from checks import Check, Count, TestCase


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Returns the command with two stages of one check and one that cannot run here; it logs to the test's folder."""
    spec = importlib.util.spec_from_file_location(
        "runner", Path(checks.__file__).with_name("test.py")
    )
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    # Its stages are dataclasses, which look up their module in sys.modules.
    monkeypatch.setitem(sys.modules, "runner", module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(checks, "LOG", tmp_path)
    module.LOG = tmp_path

    def stage(name: str, program: str) -> Iterator[Check]:
        yield Check(name, [sys.executable, "-c", program])

    def need() -> None:
        raise module.StageSkipped("no engine")

    module.STAGES.clear()
    module.STAGES["lint"] = module.Stage(lambda: stage("ruff", ""))
    module.STAGES["unit"] = module.Stage(lambda: stage("harness/unit", ""))
    module.STAGES["containers"] = module.Stage(
        lambda: stage("containers-fleet", "1 / 0"), need=need
    )
    return module


def test_a_text_that_no_check_has_in_its_name_is_an_error_though_a_stage_is_skipped(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert runner.main(["--only", "typo"]) == 2
    assert tuple(capsys.readouterr()) == ("", "no check's name contains 'typo'\n")


def test_a_text_of_another_stage_is_an_error(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert runner.main(["lint", "--only", "harness"]) == 2
    assert capsys.readouterr().err == "no check's name contains 'harness'\n"


def test_only_stages_with_such_a_check_are_reported(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert runner.main(["--only", "harness"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["unit", "1"]


def test_a_stage_that_cannot_run_here_is_reported_as_skipped(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert runner.main([]) == 0
    assert "containers skipped  no engine" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["soak", "fuzz"])
def test_what_takes_long_takes_no_stage(
    runner: ModuleType, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        runner.main([f"--{name}", "unit"])
    assert ended.value.code == 2
    assert capsys.readouterr().err.endswith(
        f"--{name} runs only what takes long: it takes no stage, not unit\n"
    )


def test_faults_of_a_swarm_run_only_where_they_are_asked_for(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "containers-swarm" not in [check.name for check in runner.containers()]
    assert [check.name for check in runner.swarm()] == ["containers-swarm"]
    for words in (["--swarm"], ["unit", "--swarm"], ["containers", "unit", "--swarm"]):
        with pytest.raises(SystemExit) as ended:
            runner.arguments_from(words)
        assert ended.value.code == 2
        assert capsys.readouterr().err.endswith(
            "--swarm is for one stage: ./pioneer test containers --swarm\n"
        )
    runner.arguments_from(["containers", "--swarm"])
    assert [check.name for check in runner.STAGES["containers"].checks()] == ["containers-swarm"]


def test_two_runs_in_one_checkout_do_not_meet(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    with runner.the_only_run():
        assert runner.main(["lint"]) == 2
    assert tuple(capsys.readouterr()) == ("", "another test run is under way in this checkout\n")
    assert runner.main(["lint"]) == 0
    assert str(Count(passed=1)) in capsys.readouterr().out


def test_quick_chooses_the_stages_that_start_no_fleet(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert runner.arguments_from(["--quick"]).stages == ["lint", "types", "unit", "launch"]
    with pytest.raises(SystemExit):
        runner.arguments_from(["--quick", "unit"])
    assert "--quick chooses the stages itself" in capsys.readouterr().err


def test_a_failed_check_says_how_to_repeat_it(
    runner: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = Check("nav_bundle/unit", [sys.executable, "-c", "1 / 0"])
    runner.STAGES["unit"] = runner.Stage(lambda: iter([broken]))
    # The log's path is printed below the folder of the project.
    runner.ROOT = checks.LOG
    assert runner.main(["unit"]) == 1
    assert "again: ./pioneer test unit --only 'nav_bundle/unit'" in capsys.readouterr().out


def test_skipped_tests_are_grouped_by_reason_and_slow_ones_listed(runner: ModuleType) -> None:
    cases = [
        TestCase("a", "test_slow", 12.3),
        TestCase("a", "test_quick", 0.2),
        TestCase("b", "test_x", 0.0, "needs root"),
        TestCase("b", "test_y", 0.0, "needs root"),
    ]
    lines = list(runner.summary(cases))
    assert lines == ["skipped 2: needs root", "the slowest of 4 tests:", "    12.3 s  a: test_slow"]
