"""``./pioneer experiment``: executes a study's missing runs and writes the report of all runs."""

import dataclasses
import json
import os
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pioneer_demo.adapters.cluster import Cluster
from pioneer_demo.adapters.interrupt import Interrupt, Interrupted
from pioneer_demo.adapters.scenario_file import scenario_of, scenario_path
from pioneer_demo.adapters.study_report import write_report
from pioneer_demo.core.error import DemoError, OptionError
from pioneer_demo.core.option import Machine
from pioneer_demo.core.scenario import Scenario
from pioneer_demo.core.study import Run, Study, merged
from pioneer_demo.core.study_option import ExperimentConfig, experiment_config
from pioneer_harness.proc import processors
from pioneer_node.adapters.document import read_content, read_document
from pioneer_node.core.document import DocumentError

_POLL, _SHOW = 0.5, 30.0
_FAILED, _BAD_ARGUMENTS = 1, 2


def main(arguments: Sequence[str], interrupt: Interrupt) -> int:
    """Runs a study; returns the exit status: 0 once all runs are done, successful or not."""
    try:
        config = experiment_config(arguments, Machine({}, 0, processors()))
        study, scenarios = prepared(config)
        return _run(config, study, scenarios, interrupt)
    except Interrupted as error:
        print(f"{error}: every process of this experiment has ended; the same command resumes it.")
        return error.status
    except OptionError as error:
        print(f"pioneer experiment: {error}", file=sys.stderr)
        return _BAD_ARGUMENTS
    except (DemoError, OSError) as error:
        print(f"pioneer experiment: {error}", file=sys.stderr)
        return _FAILED


def prepared(config: ExperimentConfig) -> tuple[Study, dict[str, str]]:
    """Returns the study, and each variant's scenario as text with absolute paths.

    Raises:
        OptionError: the study, its scenario or a variant is invalid.
    """
    try:
        study = read_document(Study, config.study)
        if config.runs:
            study = dataclasses.replace(study, runs=config.runs)
        beside = config.study.parent / study.scenario
        path = beside if beside.is_file() else scenario_path(Path(study.scenario))
        content, lines = read_content(path)
        scenario_of(content, path, lines)
    except DocumentError as error:
        raise OptionError(str(error)) from None
    scenarios = {}
    for name, change in study.variants.items():
        whole = merged(content, change)
        try:
            said = scenario_of(whole, path, {(): 1})
        except DocumentError as error:
            raise OptionError(f"{config.study}: variant {name}: {str(error).partition(': ')[2]}") from None
        scenarios[name] = yaml.safe_dump({**whole, **_with_paths(said, whole)})
    return study, scenarios


def _with_paths(said: Scenario, content: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the fields that name files, with absolute paths: a run has its scenario in another folder."""
    fields: dict[str, Any] = {"world": said.world, "navigation": said.navigation}
    if not isinstance(said.robots, int):
        files = [{name: getattr(one, name) for name in ("description", "navigation")} for one in said.robots]
        fields["robots"] = [{**one, **own} for one, own in zip(content["robots"], files, strict=True)]
    return fields


def _run(config: ExperimentConfig, study: Study, scenarios: Mapping[str, str], interrupt: Interrupt) -> int:
    folder = config.output
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    _check_same(folder / "study.json", {"scenarios": scenarios, "program": study.program})
    paths = {run: folder / "runs" / f"{run.name}.json" for run in study.all_runs()}
    rows = {run: json.loads(path.read_text()) for run, path in paths.items() if path.is_file()}
    missing = [run for run in paths if run not in rows]
    if rows:
        print(f"{len(rows)} of {len(rows) + len(missing)} runs exist in {folder / 'runs'}", flush=True)
    failures = _do(config, study, scenarios, missing, rows, interrupt) if missing else []
    for line in failures:
        print(f"not done: {line}")
    if rows:
        write_report(study, [rows[run] for run in sorted(rows)], folder)
        print(f"Written: runs.csv, summary.json and report.html in {folder}")
    return 1 if failures else 0


def _do(
    config: ExperimentConfig, study: Study, scenarios: Mapping[str, str], missing: Sequence[Run],
    rows: dict[Run, dict[str, Any]], interrupt: Interrupt,
) -> list[str]:  # fmt: skip
    """Executes the missing runs, adds their rows to ``rows`` and the folder; returns the reasons of failed runs."""
    folder, began, shown = config.output, time.monotonic(), 0.0
    failures, done = list[str](), 0
    with Cluster(config.scheduler, config.jobs) as cluster:
        print(f"{len(missing)} runs, {cluster.workers} at a time", flush=True)
        keep = {run: str(folder.resolve() / "reports" / run.name) if config.keep else "" for run in missing}
        program = shlex.split(study.program)
        for result in cluster.results(program, {run: scenarios[run.variant] for run in missing}, keep, _POLL):
            interrupt.check()
            if result is not None:
                run, row = result
                done += 1
                if isinstance(row, str):
                    failures.append(f"{run.name}: {row}")
                else:
                    rows[run] = row
                    _write(folder / "runs" / f"{run.name}.json", row)
            if (result is not None or time.monotonic() - shown > _SHOW) and done:
                shown = time.monotonic()
                left = (shown - began) / done * (len(missing) - done)
                print(f"{done} of {len(missing)} runs; about {left / 60:.0f} min left", flush=True)
    return failures


def _check_same(path: Path, content: Mapping[str, Any]) -> None:
    """Records the study's content in the folder; raises `OptionError` if the folder holds runs of another study."""
    if not path.is_file():
        _write(path, content)
    elif json.loads(path.read_text()) != content:
        raise OptionError(f"the runs in {path.parent} are of another scenario or other variants: give another --output")


def _write(path: Path, content: Mapping[str, Any]) -> None:
    """Writes a JSON file atomically."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=2) + "\n")
    os.replace(part, path)
