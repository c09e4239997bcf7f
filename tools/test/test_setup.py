"""Set-up reports each problem in one line and repairs an interrupted installation."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Timeout for processes that hang [s]; creating an environment takes 30 s on a busy machine.
HANGS = 120


def run_bash(script: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    text = f'set -euo pipefail; root={cwd}; . "{ROOT}/tools/setup.bash"; {script}'
    return subprocess.run(
        ["bash", "-c", text], capture_output=True, text=True, cwd=cwd, timeout=HANGS, check=False
    )


@pytest.mark.parametrize(
    "release", ["ID=ubuntu\nVERSION_ID=24.04\n", "ID=debian\nVERSION_ID=11\n", ""]
)
def test_a_wrong_system_is_named_in_one_line(tmp_path: Path, release: str) -> None:
    (tmp_path / "os-release").write_text(release)
    result = run_bash(f"check_system {tmp_path}/os-release", tmp_path)
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "Debian 12 or 13 is required" in result.stderr


@pytest.mark.parametrize("version", ["12", "13"])
def test_both_debians_that_ship_ros_are_taken(tmp_path: Path, version: str) -> None:
    (tmp_path / "os-release").write_text(f"ID=debian\nVERSION_ID={version}\n")
    assert run_bash(f"check_system {tmp_path}/os-release", tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("Temporary failure resolving 'deb.debian.org'", "no network"),
        ("NewConnectionError: Failed to establish", "no network"),
        ("cp: error writing: No space left on device", "the disk is full"),
    ],
)
def test_the_usual_causes_of_a_failed_step_are_reported_in_one_line(
    tmp_path: Path, said: str, told: str
) -> None:
    result = run_bash(
        f'fail() {{ echo "{said}"; return 1; }}; step "Installing" {tmp_path}/log/x.log fail',
        tmp_path,
    )
    assert result.returncode == 1
    assert told in result.stderr
    assert result.stderr.count("\n") == 1


LOCKER = """
import fcntl, sys
file = open(sys.argv[1], "w")
fcntl.lockf(file, fcntl.LOCK_EX)
print("locked", flush=True)
sys.stdin.readline()
"""


def test_set_up_waits_for_another_program_that_installs_packages(tmp_path: Path) -> None:
    lock = tmp_path / "lock-frontend"
    with subprocess.Popen(
        [sys.executable, "-c", LOCKER, lock], stdin=-1, stdout=-1, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdin is not None
        other.stdout.readline()
        late = run_bash(f"package_patience=0; await_packages {lock}", tmp_path)
        assert late.returncode == 1
        assert f"({other.pid}) has held {lock} for 0 s" in late.stdout
        script = f"await_packages {tmp_path}/none {lock}; echo installed"
        text = f'root={tmp_path}; . "{ROOT}/tools/setup.bash"; {script}'
        with subprocess.Popen(
            ["bash", "-euo", "pipefail", "-c", text], stdout=-1, text=True
        ) as waiting:
            assert waiting.stdout is not None
            assert f"({other.pid}), which installs packages" in waiting.stdout.readline()
            other.stdin.write("\n")
            other.stdin.flush()
            rest, _ = waiting.communicate(timeout=HANGS)
    assert rest.endswith("installed\n")
    assert waiting.returncode == 0


def test_a_full_disk_is_noticed_before_anything_is_installed(tmp_path: Path) -> None:
    result = run_bash("minimum_free_mib=999999999; check_disk", tmp_path)
    assert result.returncode == 1
    assert "free some space" in result.stderr


def test_an_unexpected_failure_shows_the_end_of_its_log(tmp_path: Path) -> None:
    result = run_bash(
        f'fail() {{ echo "a clue"; return 1; }}; step "Building" {tmp_path}/log/x.log fail',
        tmp_path,
    )
    assert result.returncode == 1
    assert "a clue" in result.stderr


def test_an_interrupted_environment_is_made_again(tmp_path: Path) -> None:
    (tmp_path / "requirements.txt").write_text("")
    (tmp_path / ".setup" / "venv").mkdir(parents=True)
    (tmp_path / ".setup" / "venv" / "half").write_text("done")
    (tmp_path / "catkin_ws" / "src").mkdir(parents=True)
    built = "make_and_compile() { mkdir -p $workspace/devel; touch $workspace/devel/setup.bash; }"
    result = run_bash(
        f"{built}; prepare_python_and_workspace; prepare_python_and_workspace", tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert not (tmp_path / ".setup" / "venv" / "half").exists()
    assert result.stdout.count("done in") == 1


FLEET = """
import os, sys, time
os.environ["PIONEER_FLEET_COMMAND"] = f"{os.readlink('/proc/self/ns/pid')}:{os.getpid()}:1"
os.environ["PIONEER_ROOT"] = sys.argv[1]
node = os.posix_spawn("/bin/sh", ["sh", "-c", "echo; read line"], os.environ)
os.waitpid(node, 0)
"""


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator["subprocess.Popen[str]"]:
    """Yields a command with a process that says which command and checkout it belongs to, as a fleet's nodes do."""
    with subprocess.Popen(
        [sys.executable, "-c", FLEET, tmp_path], stdin=-1, stdout=-1, text=True
    ) as command:
        assert command.stdout is not None
        command.stdout.readline()
        yield command
        command.communicate(timeout=HANGS)


BUILT = """
make_and_compile() { mkdir -p $workspace/devel; touch $workspace/devel/setup.bash; }
make_venv() { mkdir -p $venv; touch $venv/pyvenv.cfg; }
pip_install() { true; }
mkdir -p $workspace/src
touch $root/requirements.txt
"""


def test_a_pull_under_a_running_fleet_builds_and_says_what_the_fleet_has(
    tmp_path: Path, fleet: "subprocess.Popen[str]"
) -> None:
    first = run_bash(f"{BUILT} prepare_python_and_workspace", tmp_path)
    assert first.returncode == 0, first.stderr
    pulled = "touch $workspace/src/package.xml"
    result = run_bash(f"{BUILT} {pulled}; prepare_python_and_workspace", tmp_path)
    assert result.returncode == 0, result.stderr
    said = f"The fleet of process {fleet.pid} has the former sources until it is started again\n"
    assert result.stdout.endswith(said)


@pytest.mark.parametrize(
    ("pulled", "what"),
    [
        ("printf '## run\\nnew==1\\n' >$root/requirements.txt", "the Python environment"),
        ("touch $workspace/src/package.xml $building", "the workspace"),
    ],
)
def test_what_a_running_fleet_runs_from_is_not_removed(
    tmp_path: Path, fleet: "subprocess.Popen[str]", pulled: str, what: str
) -> None:
    run_bash(f"{BUILT} prepare_python_and_workspace", tmp_path)
    again = f"{BUILT} {pulled}; prepare_python_and_workspace"
    result = run_bash(again, tmp_path)
    said = f"pioneer: {what} must be made again, and a fleet runs from it (process {fleet.pid}): end it"
    assert result.returncode == 1
    assert result.stderr.startswith(said), result.stderr
    assert (tmp_path / ".setup" / "venv" / "sections" / "run").exists()
    fleet.communicate(timeout=HANGS)
    result = run_bash(again, tmp_path)
    assert result.returncode == 0, result.stderr
    assert "done in" in result.stdout


KILLED_BUILD = """
mkdir -p $venv/bin $workspace/src
printf '#!/bin/bash\\n' >$venv/bin/python3; chmod +x $venv/bin/python3
make_workspace() {
  [[ -e $workspace/build/half ]] && echo "it found half a file"
  mkdir -p $workspace/build $workspace/devel
  touch $workspace/build/half
  %s
}
make_and_compile & wait $! || true
make_workspace() { ls $workspace; }
make_and_compile
"""


def test_a_build_after_one_that_was_killed_begins_without_its_files(tmp_path: Path) -> None:
    """A killed compiler leaves half a file that is newer than its source: make would keep it."""
    result = run_bash(KILLED_BUILD % "kill -9 $BASHPID", tmp_path)
    assert (result.returncode, result.stdout) == (0, "src\n"), result.stderr


def test_a_build_after_one_that_failed_keeps_its_files(tmp_path: Path) -> None:
    result = run_bash(KILLED_BUILD % "return 1", tmp_path)
    assert (result.returncode, result.stdout.split()) == (0, ["build", "devel", "src"])


KILLED_PIP = """
mkdir -p $venv/bin
printf '#!/bin/bash\\necho "$@"; [[ ! -e %s ]] || kill -9 $$\\n' $root/kill >$venv/bin/pip
chmod +x $venv/bin/pip
touch $root/requirements.txt $root/kill
(pip_install web) || true
rm $root/kill
pip_install study
pip_install web
"""


def test_packages_are_installed_whole_after_a_pip_that_was_killed(tmp_path: Path) -> None:
    """A killed pip leaves a package whose description is there and whose files are not: it would count as installed."""
    result = run_bash(KILLED_PIP, tmp_path)
    assert result.returncode == 0, result.stderr
    calls = ["--ignore-installed" in line for line in result.stdout.splitlines()]
    assert calls == [False, True, False]


@pytest.mark.parametrize(
    ("command", "sections"),
    [
        ("demo --robots 2", {"plot"}),
        ("demo --web --record run.mcap", {"plot", "web", "record"}),
        ("demo --video run.mp4", {"plot", "video"}),
        ("fleet --robots 2", set()),
        ("fleet --robots 2 --ros2", {"ros2"}),
        ("run rostopic list", set()),
        ("run roslaunch pioneer_description multi_pioneer_rviz.launch", {"view"}),
        ("shell", {"plot", "network", "view"}),
    ],
)
def test_a_command_installs_only_the_sections_that_it_needs(
    tmp_path: Path, command: str, sections: set[str]
) -> None:
    result = run_bash(f"sections_of {command}", tmp_path)
    assert set(result.stdout.split()) == sections, result.stderr


def test_sections_of_commands_are_sections_of_the_lists(tmp_path: Path) -> None:
    commands = (
        "demo --web --ros2 --video x",
        "replay",
        "experiment",
        "bench",
        "test",
        "setup",
        "shell",
        "run rviz",
    )
    needed = run_bash(
        "; ".join(f"sections_of {command}" for command in commands), tmp_path
    ).stdout.split()
    lists = [(ROOT / name).read_text() for name in ("apt-packages.txt", "requirements.txt")]
    known = {line[3:] for text in lists for line in text.splitlines() if line.startswith("## ")}
    assert needed
    assert set(needed) <= known
    # The command that runs all checks leaves no section out.
    everything = set(run_bash("sections_of test", tmp_path).stdout.split())
    assert everything | {"build", "run"} == known


def test_xacro_finds_packages_though_the_environment_comes_first_on_the_path(
    tmp_path: Path,
) -> None:
    (tmp_path / "robot.xacro").write_text(
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><link name="$(find pioneer_description)"/></robot>'
    )
    path = f"PATH={ROOT}/.setup/venv/bin:$PATH"
    script = (
        f"set +u; . {ROOT}/catkin_ws/devel/setup.bash; set -u; {path}; xacro {tmp_path}/robot.xacro"
    )
    result = run_bash(script, tmp_path)
    assert result.returncode == 0, result.stderr
    assert "/pioneer_description" in result.stdout


def test_an_interrupt_ends_the_running_step_and_reports_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "started")
    long = f"long() {{ echo $BASHPID > {tmp_path}/started; exec tail -f /dev/null; }}"
    script = f'{long}; step "Building" {tmp_path}/x.log long'
    text = f'set -euo pipefail; root={tmp_path}; . "{ROOT}/tools/setup.bash"; {script}'
    process = subprocess.Popen(["bash", "-c", text], stderr=subprocess.PIPE, text=True)
    step = int((tmp_path / "started").read_text())
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=HANGS)
    assert process.returncode == 1
    assert "interrupted" in error
    with pytest.raises(ProcessLookupError):
        os.kill(step, 0)
