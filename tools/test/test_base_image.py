"""docker/base with an existing image, and without any way to get one: one line says what to do."""

import os
import subprocess
from pathlib import Path

import pytest

BASE = Path(__file__).parents[2] / "docker" / "base"
TOOLS = ("bash", "env", "timeout", "mktemp", "rm", "tar", "cat", "find", "sleep")
"""Programs that docker/base may use in addition to those that a test provides."""
AS_ROOT = pytest.mark.skipif(
    os.geteuid() != 0, reason="as a user, docker/base ends before debootstrap"
)
PULL = 'echo "Error response from daemon: dial tcp: lookup registry-1.docker.io: no such host" >&2; exit 1'


def run_base(
    folder: Path, programs: dict[str, str], **variables: str
) -> "subprocess.CompletedProcess[str]":
    """Runs docker/base on a machine with these programs, each a bash script; each call is logged to ``calls``."""
    (folder / "bin").mkdir()
    for name in TOOLS:
        (folder / "bin" / name).symlink_to(Path("/usr/bin") / name)
    for name, script in programs.items():
        program = folder / "bin" / name
        program.write_text(f'#!/usr/bin/bash\necho "{name} $*" >>{folder}/calls\n{script}\n')
        program.chmod(0o755)
    environment = {"PATH": str(folder / "bin"), "TMPDIR": str(folder), **variables}
    return subprocess.run(
        [BASE], env=environment, capture_output=True, text=True, timeout=30, check=False
    )


def docker(inspect: str = "exit 1", pull: str = PULL, version: str = "exit 0") -> str:
    return f"case $1 in image) {inspect} ;; pull) {pull} ;; version) {version} ;; *) cat >/dev/null ;; esac"


def test_an_image_that_is_there_is_left_alone(tmp_path: Path) -> None:
    done = run_base(tmp_path, {"docker": docker(inspect="exit 0"), "debootstrap": "exit 0"})
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert "pull" not in (tmp_path / "calls").read_text()


def test_an_image_that_a_registry_gives_is_pulled_and_not_made(tmp_path: Path) -> None:
    done = run_base(tmp_path, {"docker": docker(pull="exit 0"), "debootstrap": "exit 0"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "docker pull debian:bookworm-slim" in (tmp_path / "calls").read_text()
    assert "debootstrap" not in (tmp_path / "calls").read_text()


def test_a_slow_pull_continues_once_the_registry_has_answered(tmp_path: Path) -> None:
    slow = (
        "echo bookworm-slim: Pulling from library/debian; sleep 4; "
        "echo 5a4f: Pull complete; echo Status: done; exit 0"
    )
    done = run_base(tmp_path, {"docker": docker(pull=slow)}, PIONEER_REGISTRY_SECONDS="3")
    assert (done.returncode, done.stderr) == (0, "")
    assert "Pull complete" in done.stdout


def test_a_pull_that_takes_too_long_is_reported_as_that_and_nothing_else_is_tried(
    tmp_path: Path,
) -> None:
    endless = "echo bookworm-slim: Pulling from library/debian; exec sleep 100"
    done = run_base(
        tmp_path,
        {"docker": docker(pull=endless), "debootstrap": "exit 0"},
        PIONEER_PULL_SECONDS="0.5",
    )
    said = "docker/base: the pull took longer than 0.5 s; run it yourself: docker pull debian:bookworm-slim\n"
    assert (done.returncode, done.stderr) == (1, said)
    assert "debootstrap" not in (tmp_path / "calls").read_text()


@AS_ROOT
def test_a_registry_that_says_nothing_is_given_up_long_before_a_slow_one(tmp_path: Path) -> None:
    done = run_base(
        tmp_path, {"docker": docker(pull="exec sleep 100")}, PIONEER_REGISTRY_SECONDS="0.5"
    )
    assert done.returncode == 1
    assert (
        "no registry gives debian:bookworm-slim (no answer in 0.5 s), and debootstrap"
        in done.stderr
    )
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("programs", "told"),
    [
        ({}, "apt install docker.io"),
        ({"docker": docker(version="exit 1")}, "the Docker engine does not answer"),
        pytest.param(
            {"docker": docker()},
            "no such host), and debootstrap, which makes it, is missing",
            marks=AS_ROOT,
        ),
        pytest.param(
            {"docker": docker(), "apt-get": "exit 100"},
            "no such host), and apt-get could not install debootstrap",
            marks=AS_ROOT,
        ),
    ],
    ids=["no-docker", "no-engine", "no-debootstrap-and-no-apt", "no-debootstrap-and-no-mirror"],
)
def test_where_no_way_is_open_one_line_says_what_to_do(
    tmp_path: Path, programs: dict[str, str], told: str
) -> None:
    done = run_base(tmp_path, programs)
    assert done.returncode == 1
    assert told in done.stderr
    assert done.stderr.count("\n") == 1


@AS_ROOT
def test_a_debootstrap_that_fails_is_reported_with_its_mirror_and_leaves_nothing(
    tmp_path: Path,
) -> None:
    done = run_base(
        tmp_path,
        {"docker": docker(), "debootstrap": 'echo >"$3/half"; echo "E: no Release file"; exit 1'},
    )
    assert done.returncode == 1
    assert "could not make debian:bookworm-slim from http://deb.debian.org/debian" in done.stderr
    assert "E: no Release file" in done.stdout
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.glob("tmp.*")), "the folder it was made in"
    assert "import" not in (tmp_path / "calls").read_text()
