"""The command line before any work is done: help, unknown commands, completion."""

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


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_a_sentence_and_an_example(command: str) -> None:
    done = run(command, "--help")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: ./pioneer {command}")
    text = " ".join(done.stdout.split())
    assert f"xample: ./pioneer {command}" in text
    assert ". " in text.partition("options:")[0]


@pytest.mark.parametrize(
    "command", ["demo", "fleet", "test", "bench", "run", "shell", "setup", "package", "docs", "up"]
)
def test_help_needs_no_set_up(tmp_path: Path, command: str) -> None:
    """Help needs Python's standard library and a checkout, but no tools that set-up installs."""
    (tmp_path / "pioneer").write_text((ROOT / "pioneer").read_text())
    (tmp_path / "tools").symlink_to(ROOT / "tools")
    (tmp_path / "catkin_ws").mkdir()
    (tmp_path / "catkin_ws" / "src").symlink_to(ROOT / "catkin_ws" / "src")
    done = subprocess.run(
        ["bash", tmp_path / "pioneer", command, "--help"], capture_output=True, text=True, timeout=HANGS, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / ".setup").exists()


def test_bench_lists_every_bench() -> None:
    text = run("bench", "--help").stdout
    assert all(f"\n    {bench}" in text for bench in ("sim", "accuracy", "gateway", "nav", "containers"))


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
    done = subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=HANGS, check=True)
    assert [word for word in done.stdout.split() if word != "--waypoints"] == offered


def test_python_alone_answers_help() -> None:
    """The help of demo also appears on a machine without python3-yaml, which set-up installs."""
    script = "import sys; sys.modules['yaml'] = None; import cli; sys.exit(cli.main(['help', 'demo']))"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT / "tools", capture_output=True, text=True, timeout=HANGS, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "--waypoints" in done.stdout
