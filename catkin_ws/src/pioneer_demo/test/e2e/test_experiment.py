"""Experiments: the state after a killed worker or Ctrl-C, and how the same command continues from it."""

import csv
import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pioneer_demo.console.output_folder import FolderLock
from pioneer_demo.scenario.scenario_file import scenario_folder
from pioneer_harness.wait import wait_until

PROGRAM = Path(__file__).with_name("study_program.py")
PATIENCE = 120.0
RUNS = 8


@pytest.fixture
def study(tmp_path):
    journal = tmp_path / "journal"
    journal.write_text("")
    (tmp_path / "s.yaml").write_text(f"about: {journal}\nworld: small_world\nwaypoints: 1\n")
    (tmp_path / "study.yaml").write_text(
        f"scenario: s.yaml\nruns: {RUNS // 2}\nprogram: {sys.executable} {PROGRAM}\n"
        "variants:\n  near: {}\n  far: {waypoints: 2, success: {reached: 0.5}}\n"
    )
    return tmp_path


def python(study, *words, **options):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen(
        [sys.executable, "-m", *words], cwd=study, env=environment, text=True, stderr=subprocess.STDOUT,
        start_new_session=True, **options,
    )  # fmt: skip


def experiment(study, *where):
    words = (
        "pioneer_demo",
        "experiment",
        "study.yaml",
        "--output",
        "out",
        *(where or ("--jobs", "2")),
    )
    return python(study, *words, stdout=subprocess.PIPE)


def is_whole(file):
    """Returns whether a JSON file is written to its end: its writer makes it first and fills it then."""
    return file.is_file() and file.read_text().rstrip().endswith("}")


@pytest.fixture
def scheduler(study):
    """Yields the address of a manually started scheduler with one worker."""
    file, common = (
        study / "scheduler.json",
        ["--no-dashboard", "--scheduler-file", "scheduler.json"],
    )
    with (study / "dask.txt").open("w") as log:
        words = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *common]
        running = [python(study, *words, stdout=log)]
        wait_until(lambda: is_whole(file), "the scheduler's file", PATIENCE)
        words = ["distributed.cli.dask_worker", "--nthreads", "1", "--host", "127.0.0.1", *common]
        running.append(python(study, *words, stdout=log))
        yield json.loads(file.read_text())["address"]
        for process in reversed(running):
            process.terminate()
            process.wait(PATIENCE)


def noted(study, word):
    """Returns [variant, seed] and the worker of each run that has begun or ended."""
    lines = [line.split(" ") for line in (study / "journal").read_text().splitlines()]
    return [(line[1:3], int(line[3])) for line in lines if line[0] == word]


def test_a_killed_worker_and_ctrl_c_lose_no_run_and_repeat_none_that_was_done(study):
    first = experiment(study)
    wait_until(lambda: noted(study, "begin"), "the first run", PATIENCE)
    os.kill(noted(study, "begin")[-1][1], signal.SIGKILL)
    results = study / "out" / "runs"
    wait_until(lambda: len(list(results.glob("*.json"))) >= 3, "three results", PATIENCE)
    first.send_signal(signal.SIGINT)
    text, _ = first.communicate(timeout=PATIENCE)
    assert first.returncode == 130, text
    kept = {path.stem: path.read_text() for path in results.glob("*.json")}
    assert 3 <= len(kept) < RUNS

    second = experiment(study)
    text, _ = second.communicate(timeout=PATIENCE)
    assert second.returncode == 0, text
    assert f"{len(kept)} of {RUNS} runs exist" in text
    assert {name: (results / f"{name}.json").read_text() for name in kept} == kept
    rows = list(csv.DictReader((study / "out" / "runs.csv").read_text().splitlines()))
    assert [(row["variant"], row["seed"]) for row in rows] == [
        (variant, str(seed)) for variant in ("near", "far") for seed in range(1, 5)
    ]
    ended = [run for run, _ in noted(study, "end")]
    for name in kept:
        variant, seed = name.split("-")
        assert ended.count([{"near": "1", "far": "2"}[variant], seed]) == 1, (
            "done once and not again"
        )
    variants = json.loads((study / "out" / "summary.json").read_text())["variants"]
    assert variants["near"]["success"] == {"count": 3, "rate": 0.75, "low": pytest.approx(0.194, abs=1e-3),
        "high": pytest.approx(0.994, abs=1e-3)}  # fmt: skip
    assert variants["far"]["difference"]["seconds"] == {
        "count": 4, "unfinished": 0, "mean": 10.0, "median": 10.0
    }  # fmt: skip
    assert "<svg" in (study / "out" / "report.html").read_text()


def test_what_a_killed_experiment_has_left_is_removed_by_the_next(study, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(study / "tmp"))
    (study / "tmp").mkdir()
    first = experiment(study)
    wait_until(lambda: noted(study, "begin"), "the first run", PATIENCE)
    first.kill()
    first.communicate(timeout=PATIENCE)
    assert list((study / "out").glob("scratch-*")) != []
    second = experiment(study)
    text, _ = second.communicate(timeout=PATIENCE)
    assert second.returncode == 0, text
    assert list((study / "out").glob("scratch-*")) == []
    assert list((study / "tmp").iterdir()) == []


def test_the_workers_of_a_scheduler_do_the_runs(study, scheduler):
    done = experiment(study, "--scheduler", scheduler)
    text, _ = done.communicate(timeout=PATIENCE)
    assert done.returncode == 0, text
    assert f"{RUNS} of {RUNS} runs" in text
    assert len({worker for _, worker in noted(study, "end")}) == 1
    assert len(list((study / "out" / "runs").glob("*.json"))) == RUNS


def test_a_scheduler_that_does_not_exist_is_named(study):
    done = experiment(study, "--scheduler", "tcp://127.0.0.1:1")
    text, _ = done.communicate(timeout=PATIENCE)
    assert done.returncode == 1
    assert "pioneer experiment: no scheduler at tcp://127.0.0.1:1: " in text


def test_ctrl_c_ends_a_study_whose_scheduler_never_answers(study):
    with socket.create_server(("127.0.0.1", 0)) as mute:
        stuck = experiment(study, "--scheduler", f"tcp://127.0.0.1:{mute.getsockname()[1]}")
        mute.settimeout(PATIENCE)
        connection, _ = mute.accept()
        with connection:
            began = time.monotonic()
            stuck.send_signal(signal.SIGINT)
            text, _ = stuck.communicate(timeout=PATIENCE)
    assert stuck.returncode == 130, text
    assert time.monotonic() - began < 30.0
    assert "every process of this experiment has ended" in text


def test_two_studies_at_once_finish_whoever_holds_dasks_common_folder(study, monkeypatch):
    """A lock of dask's folder in /tmp, which all studies shared, once stopped every start without an end."""
    common = study / "tmp" / "dask-worker-space"
    common.mkdir(parents=True)
    monkeypatch.setenv("TMPDIR", str(study / "tmp"))
    (study / "other.yaml").write_text(
        (study / "study.yaml").read_text().replace(f"runs: {RUNS // 2}", "runs: 1")
    )
    with (common / "global.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        words = ("pioneer_demo", "experiment", "other.yaml", "--jobs", "1", "--output")
        both = [python(study, *words, name, stdout=subprocess.PIPE) for name in ("one", "two")]
        texts = [process.communicate(timeout=PATIENCE)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], texts
    for name in ("one", "two"):
        assert not list((study / name).glob("scratch-*"))


def test_two_studies_on_one_scheduler_keep_their_results_apart(study, scheduler):
    """Their variants have the same names; the one's waypoints decide its figures."""
    text = (study / "study.yaml").read_text()
    (study / "other.yaml").write_text(text.replace("near: {}", "near: {waypoints: 5}"))
    words = ("--scheduler", scheduler, "--runs", "2")
    both = [
        python(
            study,
            "pioneer_demo",
            "experiment",
            f"{name}.yaml",
            *words,
            "--output",
            name,
            stdout=subprocess.PIPE,
        )
        for name in ("study", "other")
    ]
    texts = [process.communicate(timeout=PATIENCE)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], texts
    for name, seconds in (("study", 11.0), ("other", 51.0)):
        assert json.loads((study / name / "runs" / "near-1.json").read_text())["seconds"] == seconds


def test_one_folder_takes_one_study_at_a_time(study):
    with FolderLock(study / "out"):
        done = experiment(study)
        text, _ = done.communicate(timeout=PATIENCE)
    assert done.returncode == 2
    assert f"--output: out is in use by process {os.getpid()}" in text


def test_a_study_does_not_continue_with_a_file_that_has_changed(study):
    world = study / "hall.world"
    shutil.copy(scenario_folder() / "world" / "corridor.world", world)
    with (study / "s.yaml").open("a") as scenario:
        scenario.write("world: hall.world\n")
    (study / "s.yaml").write_text(
        (study / "s.yaml").read_text().replace("world: small_world\n", "")
    )
    first = experiment(study, "--jobs", "2", "--runs", "1")
    text, _ = first.communicate(timeout=PATIENCE)
    assert first.returncode == 0, text
    world.write_text(world.read_text() + "<!-- other walls -->")
    second = experiment(study, "--jobs", "2", "--runs", "1")
    text, _ = second.communicate(timeout=PATIENCE)
    assert second.returncode == 2
    assert (
        f"{world} has changed since the runs in out: restore it, or give another --output" in text
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("scenario: none", "there is no scenario none"),
        (
            "scenario: head_on\nvariants:\n  a: {wrold: x}",
            "variant a: unknown field wrold; did you mean world?",
        ),
        ("scenario: head_on\nrunns: 3", "study.yaml:2: unknown field runns; did you mean runs?"),
        (
            "scenario: head_on\nvariants:\n  a: {}\n  b: {seed: 1}",
            "study.yaml:4: variant b: it is equal to variant a",
        ),
        (
            "scenario: head_on\nvariants:\n  a: {}\n  b:\n    rounds: 0",
            "study.yaml:5: variant b: rounds must be 1 to 1000, not 0",
        ),
        ("scenario: head_on\nfirst_seed: -1", "study.yaml:2: first_seed must be 0 to"),
    ],
)
def test_a_wrong_study_is_one_line(study, text, told):
    (study / "study.yaml").write_text(text)
    done = experiment(study)
    said, _ = done.communicate(timeout=PATIENCE)
    assert (done.returncode, said.count("\n")) == (2, 1), said
    assert told in said


def test_a_folder_keeps_to_its_study(study):
    (study / "out" / "runs").mkdir(parents=True)
    (study / "out" / "study.json").write_text("{}")
    done = experiment(study)
    said, _ = done.communicate(timeout=PATIENCE)
    assert done.returncode == 2
    assert "are of another scenario or other variants" in said
