"""``./pioneer`` itself: what it refuses before any work, and how it ends."""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Timeout for processes that hang [s].
HANGS = 60


def run(*command: str | Path | bytes, **options: object) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command, capture_output=True, text=True, timeout=HANGS, check=False, **options
    )


def copied(folder: Path) -> Path:
    """Returns a copy of ``./pioneer`` in its own checkout, without anything that set-up creates."""
    shutil.copytree(ROOT / "tools", folder / "tools", ignore=shutil.ignore_patterns("test"))
    return Path(shutil.copy(ROOT / "pioneer", folder))


@pytest.mark.parametrize("name", ["with space", "semi;colon", "col:on"])
def test_a_checkout_where_cmake_cannot_build_is_refused_before_any_work(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).mkdir()
    done = run(copied(tmp_path / name), "demo")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert f"in '{tmp_path / name}', where CMake" in done.stderr
    assert not (tmp_path / name / ".setup").exists()


def test_it_may_be_called_through_symlinks_to_file_and_folder(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(ROOT / "pioneer")
    (tmp_path / "folder").symlink_to(ROOT)
    for path in (tmp_path / "link", tmp_path / "folder" / "pioneer"):
        done = run(path, "run", "printenv", "CMAKE_PREFIX_PATH")
        assert done.stdout.startswith(str(ROOT / "catkin_ws" / "devel")), done.stdout + done.stderr


def test_a_closed_standard_output_is_refused_in_one_line() -> None:
    done = run("bash", "-c", 'exec "$0" demo >&-', ROOT / "pioneer")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "standard output is closed" in done.stderr


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ([b"--report", b"/tmp/caf\xe9"], "--report must be UTF-8, not b'/tmp/caf\\xe9'"),
        (["--report", "/proc/foo"], "--report: cannot create the folder /proc/foo"),
        (["--report", "/dev/null"], "--report must be a folder; /dev/null is a file"),
        (
            ["--video", "/nonexistent/run.mp4", "--report", "new"],
            "--video: there is no folder /nonexistent",
        ),
    ],
)
def test_outputs_that_cannot_be_written_are_refused_before_anything_is_created(
    tmp_path: Path, options: list[str | bytes], told: str
) -> None:
    done = run(ROOT / "pioneer", "demo", *options, cwd=tmp_path)
    assert done.returncode == 2
    assert told in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["replay", "none.bag"], "there is no recording none.bag"),
        (["run", "none"], "pioneer: run: there is no command 'none'"),
        (
            ["fleet", "--fleet", "none.yaml"],
            "cannot read the fleet file none.yaml: No such file or directory",
        ),
    ],
)
def test_what_does_not_exist_is_named_in_a_sentence(
    tmp_path: Path, words: list[str], told: str
) -> None:
    done = run(ROOT / "pioneer", *words, cwd=tmp_path)
    assert done.returncode != 0
    assert told in done.stderr
    assert not done.stdout


def test_a_reader_that_ends_is_reported_in_one_line_and_ends_the_demo(tmp_path: Path) -> None:
    script = f"{ROOT}/pioneer demo --report {tmp_path}/report | true; exit ${{PIPESTATUS[0]}}"
    done = run("bash", "-c", script)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "every process of this demo" in done.stderr


@pytest.mark.parametrize("heeds", [True, False])
def test_ctrl_c_is_heard_even_if_a_command_of_the_script_ends_at_that_moment(heeds: bool) -> None:
    """Bash took it for the command's own and continued: one in fifty in the first moments of ``./pioneer demo``."""
    ends_well = "bash -c 'kill -INT $PPID'"
    heed = "heed_ctrl_c" if heeds else ":"
    script = f'root={ROOT}; . "$root/tools/setup.bash"; {heed}; {ends_well}; echo continued'
    done = run("bash", "-c", script, start_new_session=True)
    assert (done.returncode, done.stdout) == ((-signal.SIGINT, "") if heeds else (0, "continued\n"))
    assert "\nheed_ctrl_c\n" in (ROOT / "pioneer").read_text()


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8])
def test_ctrl_c_in_the_first_second_gives_no_traceback(tmp_path: Path, delay: float) -> None:
    command = [ROOT / "pioneer", "demo", "--report", tmp_path / "report"]
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    demo = subprocess.Popen(command, **both, text=True, start_new_session=True)
    time.sleep(delay)
    os.killpg(demo.pid, signal.SIGINT)
    text, _ = demo.communicate(timeout=HANGS)
    # Bash itself dies by the signal.
    assert demo.returncode in (130, -signal.SIGINT)
    assert "Traceback" not in text
