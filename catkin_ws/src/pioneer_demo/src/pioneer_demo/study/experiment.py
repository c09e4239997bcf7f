"""``./pioneer experiment``: executes a study's missing runs and writes the report of all runs."""

import dataclasses
import functools
import json
import os
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pioneer_demo.console.interrupt import Interrupt, Interrupted
from pioneer_demo.console.output_folder import FolderLock
from pioneer_demo.error import DemoError, FolderInUseError, OptionError
from pioneer_demo.processes.leftover import await_leftovers
from pioneer_demo.scenario.option import Machine
from pioneer_demo.scenario.scenario import Scenario
from pioneer_demo.scenario.scenario_file import digests, scenario_of, scenario_path
from pioneer_demo.study.cluster import Cluster
from pioneer_demo.study.option import ExperimentConfig, experiment_config
from pioneer_demo.study.report import write_report
from pioneer_demo.study.study import Run, Study, merged, time_left
from pioneer_harness.proc import processors
from pioneer_node.adapters.document import located, read_content
from pioneer_node.core.document import DocumentError, built

_POLL, _SHOW = 0.5, 30.0
_FAILED, _BAD_ARGUMENTS = 1, 2
_SCRATCH = "scratch-"


def main(arguments: Sequence[str], interrupt: Interrupt) -> int:
    """Runs a study; returns the exit status: 0 once all runs are done, successful or not."""
    try:
        config = experiment_config(arguments, Machine({}, 0, processors()))
        study, scenarios, texts = prepared(config)
        return _run(config, study, scenarios, texts, interrupt)
    except Interrupted as error:
        print(f"{error}: every process of this experiment has ended; the same command resumes it.")
        return error.status
    except OptionError as error:
        print(f"pioneer experiment: {error}", file=sys.stderr)
        return _BAD_ARGUMENTS
    except (DemoError, OSError) as error:
        print(f"pioneer experiment: {error}", file=sys.stderr)
        return _FAILED


def prepared(config: ExperimentConfig) -> tuple[Study, dict[str, Scenario], dict[str, str]]:
    """Returns the study, each variant's scenario, and the same as text with absolute paths.

    Raises:
        OptionError: the study, its scenario or a variant is invalid; the message has file and line.
    """
    try:
        return _prepared(config)
    except DocumentError as error:
        raise OptionError(str(error)) from None


def _prepared(config: ExperimentConfig) -> tuple[Study, dict[str, Scenario], dict[str, str]]:
    described, lines = read_content(config.study)
    try:
        study = built(Study, described, "a study")
    except DocumentError as error:
        raise located(error, config.study, lines) from None
    if config.runs:
        study = dataclasses.replace(study, runs=config.runs)
    beside = config.study.parent / study.scenario
    path = beside if beside.is_file() else scenario_path(Path(study.scenario))
    content, own_lines = read_content(path)
    scenario_of(content, path, own_lines)
    scenarios: dict[str, Scenario] = {}
    texts: dict[str, str] = {}
    for name, change in study.variants.items():
        whole = merged(content, change)
        try:
            scenario = scenario_of(whole, path, {(): 1})
            same = next((other for other, known in scenarios.items() if known == scenario), None)
            if same is not None:
                raise DocumentError(f": it is equal to variant {same}")
        except DocumentError as error:
            text = f"variant {name}: {str(error).partition(': ')[2]}"
            raise located(
                DocumentError(text, "variants", name, *error.place), config.study, lines
            ) from None
        scenarios[name] = scenario
        texts[name] = yaml.safe_dump({**whole, **_with_paths(scenario, whole)})
    return study, scenarios, texts


def _with_paths(said: Scenario, content: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the fields that name files, with absolute paths: a run has its scenario in another folder."""
    fields: dict[str, Any] = {"world": said.world, "navigation": said.navigation}
    if not isinstance(said.robots, int):
        files = [
            {name: getattr(one, name) for name in ("description", "navigation")}
            for one in said.robots
        ]
        fields["robots"] = [
            {**one, **own} for one, own in zip(content["robots"], files, strict=True)
        ]
    return fields


def _run(
    config: ExperimentConfig, study: Study, scenarios: Mapping[str, Scenario], texts: Mapping[str, str],
    interrupt: Interrupt,
) -> int:  # fmt: skip
    folder = config.output
    try:
        lock = FolderLock(folder)
    except FolderInUseError as error:
        raise OptionError(f"--output: {error}") from None
    with lock:
        (folder / "runs").mkdir(exist_ok=True)
        await_leftovers(functools.partial(print, flush=True), interrupt.check)
        _remove_scratch(folder)
        _check_same(folder / "study.json", texts, study.program, digests(scenarios.values()))
        paths = {run: folder / "runs" / f"{run.name}.json" for run in study.all_runs()}
        rows = {run: json.loads(path.read_text()) for run, path in paths.items() if path.is_file()}
        missing = [run for run in paths if run not in rows]
        if rows:
            print(
                f"{len(rows)} of {len(rows) + len(missing)} runs exist in {folder / 'runs'}",
                flush=True,
            )
        failures = _do(config, study, texts, missing, rows, interrupt) if missing else []
        for line in failures:
            print(f"not done: {line}")
        if rows:
            command = ["./pioneer", "experiment", str(config.study), "--runs", str(study.runs)]
            write_report(
                study,
                [rows[run] for run in sorted(rows)],
                folder,
                config.study.stem,
                shlex.join(command),
            )
            print(f"Written: runs.csv, summary.json and report.html in {folder}")
        return 1 if failures else 0


def _do(
    config: ExperimentConfig, study: Study, texts: Mapping[str, str], missing: Sequence[Run],
    rows: dict[Run, dict[str, Any]], interrupt: Interrupt,
) -> list[str]:  # fmt: skip
    """Executes the missing runs, adds their rows to ``rows`` and the folder; returns the reasons of failed runs."""
    folder = config.output
    failures: list[str] = []
    done = 0
    shown = 0.0
    program = shlex.split(study.program)
    keep = {
        run: str(folder.resolve() / "reports" / run.name) if config.keep else "" for run in missing
    }
    with (
        tempfile.TemporaryDirectory(
            prefix=_SCRATCH, dir=folder, ignore_cleanup_errors=True
        ) as scratch,
        Cluster(config.scheduler, config.jobs, Path(scratch), interrupt) as cluster,
    ):
        print(f"{len(missing)} runs, {cluster.workers} at a time", flush=True)
        for result in cluster.results(
            program, {run: texts[run.variant] for run in missing}, keep, _POLL
        ):
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
                walls = [row["wall_seconds"] for row in rows.values()]
                left = time_left(walls, len(missing) - done, cluster.workers)
                print(f"{done} of {len(missing)} runs; {left}", flush=True)
    return failures


def _check_same(
    path: Path, texts: Mapping[str, str], program: str, files: Mapping[str, str]
) -> None:
    """Records the study's content in the folder.

    Raises:
        OptionError: the folder has runs of another study, or of files that have changed.
    """
    content = {"scenarios": dict(texts), "program": program, "files": dict(files)}
    if not path.is_file():
        _write(path, content)
        return
    known = json.loads(path.read_text())
    if known == content:
        return
    if {**known, "files": files} != content:
        raise OptionError(
            f"the runs in {path.parent} are of another scenario or other variants: give another --output"
        )
    changed = sorted(
        name for name in {*files, *known["files"]} if files.get(name) != known["files"].get(name)
    )
    raise OptionError(
        f"{changed[0]} has changed since the runs in {path.parent}: restore it, or give another --output"
    )


def _remove_scratch(folder: Path) -> None:
    """Removes what a killed call has left; nobody else uses the folder, since it is locked and its processes ended."""
    for left in folder.glob(f"{_SCRATCH}*"):
        shutil.rmtree(left, ignore_errors=True)


def _write(path: Path, content: Mapping[str, Any]) -> None:
    """Writes a JSON file atomically."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=2) + "\n")
    os.replace(part, path)
