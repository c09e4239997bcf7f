"""The command line before any work is done: help, unknown commands, completion."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cli import COMMANDS, unknown

ROOT = Path(__file__).resolve().parents[2]
# Timeout for processes that hang [s].
HANGS = 60


def run(*words: str) -> "subprocess.CompletedProcess[str]":
    command = [ROOT / "pioneer", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANGS, check=False)


def bare(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Runs ``./pioneer`` in a checkout without set-up."""
    (folder / "pioneer").write_text((ROOT / "pioneer").read_text())
    (folder / "tools").symlink_to(ROOT / "tools")
    (folder / "catkin_ws").mkdir()
    (folder / "catkin_ws" / "src").symlink_to(ROOT / "catkin_ws" / "src")
    command = ["bash", folder / "pioneer", *words]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=HANGS, check=False
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_a_sentence_and_an_example(command: str) -> None:
    done = run(command, "--help")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: ./pioneer {command}")
    text = " ".join(done.stdout.split())
    assert f"xample: ./pioneer {command}" in text
    assert ". " in text.partition("options:")[0]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            "demo --bogus",
            "pioneer demo: unrecognized arguments: --bogus (see ./pioneer demo --help)",
        ),
        ("demo --world utm0", "not 'utm0'; did you mean utm_0?"),
        ("demo --robots 0", "pioneer demo: --robots must be 1 to 15 in closed_maze, not 0"),
        ("demo --robots two", "pioneer demo: argument --robots: invalid int value: 'two'"),
        ("demo --waypoints 0", "pioneer demo: --waypoints must be 1 to 50, not 0"),
        (
            "demo --limit -1",
            "pioneer demo: --limit must be 0 (in proportion to the way) or more seconds, not -1",
        ),
        ("demo --video film", "pioneer demo: --video must name a file such as run.mp4, not 'film'"),
        ("demo --rtf -1", "pioneer demo: --rtf must be 0 (as fast as possible) or more, not -1"),
        (
            "demo --rtf 1 --lockstep",
            "--rtf and --lockstep both say how fast time passes: give one of them",
        ),
        ("demo --seed -1", "pioneer demo: --seed must be 0 to 2147483647, not -1"),
        (
            "fleet --record run.txt",
            "--record must name a file such as run.mcap or run.bag, not 'run.txt'",
        ),
        (
            "fleet --robots 2 --fleet f.yaml",
            "--robots and --fleet both say how many robots there are",
        ),
        ("fleet --world", "pioneer fleet: argument --world: expected one argument"),
        ("fleet --robot 2", "pioneer fleet: unrecognized arguments: --robot 2"),
        ("run-scenario", "pioneer run-scenario: the following arguments are required: FILE"),
        (
            "run-scenario head_on --robots 3",
            "pioneer run-scenario: unrecognized arguments: --robots 3",
        ),
        ("experiment", "pioneer experiment: the following arguments are required: STUDY"),
        ("experiment none.yaml", "pioneer experiment: there is no study none.yaml"),
        (
            "experiment none.yaml --runs -2",
            "pioneer experiment: --runs must be 0 (as in the file) or more, not -2",
        ),
        ("experiment none.yaml --jobs 0", "pioneer experiment: --jobs must be 1 to 1000, not 0"),
        ("replay", "the following arguments are required: FILE"),
        ("replay none.mcap", "pioneer replay: there is no file none.mcap"),
        ("replay none.mcap --rate fast", "argument --rate: invalid float value: 'fast'"),
        ("setup now", "setup takes no arguments (got now)"),
        ("run", "run needs a command: ./pioneer run rostopic list"),
    ],
)
def test_a_mistake_is_one_line_before_any_set_up(tmp_path: Path, words: str, text: str) -> None:
    done = bare(tmp_path, *words.split())
    assert done.returncode != 0
    assert text in done.stderr
    assert "set-up" not in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / ".setup").exists()


@pytest.mark.parametrize(
    "command", ["demo", "fleet", "test", "bench", "run", "shell", "setup", "package", "docs", "up"]
)
def test_help_needs_no_set_up(tmp_path: Path, command: str) -> None:
    """Help needs Python's standard library and a checkout, but no tools that set-up installs."""
    done = bare(tmp_path, command, "--help")
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / ".setup").exists()


def test_bench_lists_every_bench() -> None:
    text = run("bench", "--help").stdout
    assert all(
        f"\n    {bench}" in text for bench in ("sim", "accuracy", "gateway", "nav", "containers")
    )


def test_an_unknown_command_suggests_the_nearest() -> None:
    done = run("dmeo")
    assert (done.returncode, done.stderr) == (
        2, "pioneer: unknown command 'dmeo': did you mean 'demo'? (./pioneer --help)\n",
    )  # fmt: skip
    assert "available: demo, fleet" in unknown("zzz")


def test_the_usage_names_every_command() -> None:
    text = run("--help").stdout
    assert all(f"\n  {command} " in text for command in COMMANDS)


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("./pioneer te", ["teleop", "test"]),
        ("./pioneer demo --wo", ["--world"]),
        ("./pioneer demo --world clo", ["closed_maze"]),
        ("./pioneer bench ac", ["accuracy"]),
        ("./pioneer test ros", ["rostest"]),
    ],
)
def test_bash_completes_commands_options_and_values(line: str, offered: list[str]) -> None:
    words = line.split(" ")
    script = f"""
    . tools/completion.bash
    COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}
    _pioneer; printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        ["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=HANGS, check=True
    )
    assert [word for word in done.stdout.split() if word != "--waypoints"] == offered


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("./pioneer replay a", ["a.bag", "a.mcap", "along/"]),
        ("./pioneer replay --repair a", ["a.bag", "a.mcap", "along/"]),
        ("./pioneer demo --record a", ["a.bag", "a.mcap", "along/"]),
        ("./pioneer experiment a", ["a.yaml", "along/"]),
        ("./pioneer run-scenario a", ["a.yaml", "along/"]),
        ("./pioneer run-scenario doorw", ["doorway"]),
        ("./pioneer fleet --fleet a", ["a.yaml", "along/"]),
        ("./pioneer demo --world a", ["a.world", "along/"]),
        ("./pioneer demo --report a", ["along"]),
    ],
)
def test_bash_completes_files_by_their_type(tmp_path: Path, line: str, offered: list[str]) -> None:
    (tmp_path / "along").mkdir()
    for suffix in ("bag", "mcap", "yaml", "world", "txt", "py"):
        (tmp_path / f"a.{suffix}").touch()
    words = line.replace("./pioneer", str(ROOT / "pioneer")).split(" ")
    script = f"""
    . {ROOT}/tools/completion.bash
    COMP_WORDS=({" ".join(words)}); COMP_CWORD={len(words) - 1}
    _pioneer; printf '%s\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=HANGS,
        check=True,
    )
    assert sorted(done.stdout.split()) == offered


def test_python_alone_answers_help() -> None:
    """The help of demo also appears on a machine without python3-yaml, which set-up installs."""
    script = (
        "import sys; sys.modules['yaml'] = None; import cli; sys.exit(cli.main(['help', 'demo']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT / "tools",
        capture_output=True,
        text=True,
        timeout=HANGS,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "--waypoints" in done.stdout


def handled(script: str) -> set[str]:
    """Returns the words that the script's first ``case`` about the command distinguishes."""
    text = (ROOT / script).read_text()
    cases = text[text.index("case $command in") :].partition("\nesac")[0]
    patterns = re.findall(r"^  ([a-z][a-z |-]*)\)", cases, re.MULTILINE)
    return {word for pattern in patterns for word in pattern.split(" | ")} - {"help"}


def test_the_registry_names_the_commands_that_the_scripts_handle() -> None:
    lines = (ROOT / "tools" / "commands.tsv").read_text().splitlines()
    rows = [line.split("\t") for line in lines if not line.startswith("#")]
    assert all(len(row) == 3 and row[1] in ("package", "checkout") for row in rows)
    assert {name for name, *_ in rows} == handled("pioneer")
    assert {name for name, place, _ in rows if place == "package"} == handled("packaging/pioneer")


def test_help_texts_are_of_registered_commands() -> None:
    help_texts = {path.stem for path in (ROOT / "tools" / "help").glob("*.txt")}
    assert help_texts <= set(COMMANDS)
