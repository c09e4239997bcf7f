"""The compose file, the image's sources and the tables: everything that can be tested without Docker."""

import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from containers import image
from containers.engine import Computer, ContainerError
from containers.image import requirements, run_step, selected_stages
from containers.layout import compose_text
from containers.report import REPORT, status_table
from pioneer_harness.wait import wait_until

DOCKER = Path(__file__).parents[2] / "docker"
SHIPPED = (DOCKER / "compose.yaml").read_text()


def test_five_robots_are_the_shipped_file() -> None:
    assert compose_text(SHIPPED, 5) == SHIPPED


@pytest.mark.parametrize("robots", [1, 15, 150])
def test_every_robot_has_the_tutorials_name_and_address(robots: int) -> None:
    text = compose_text(SHIPPED, robots)
    found = re.findall(
        r"^  (aadi\d+):\n(?:    .*\n)*?    hostname: (aadi\d+)\n(?:    .*\n)*?.*\}\.(\d+)$",
        text,
        re.M,
    )
    assert found == [
        (f"aadi{number}", f"aadi{number}", str(100 + number)) for number in range(1, robots + 1)
    ]
    assert (
        text.count("  aadiworkstation:")
        == text.count("ipv4_address: ${PIONEER_SUBNET:-192.168.2}.100")
        == 1
    )


def test_a_checkout_below_a_folder_called_test_has_its_sources_in_the_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "test" / "checkout"
    source = root / "catkin_ws" / "src" / "package"
    (source / "test").mkdir(parents=True)
    (source / "node.py").write_text("old")
    monkeypatch.setattr(image, "ROOT", root)
    monkeypatch.setattr(image, "_PARTS", ())
    before = image.source_hash()
    (source / "test" / "test_node.py").write_text("a package's tests are not in the image")
    assert image.source_hash() == before
    (source / "node.py").write_text("new")
    assert image.source_hash() != before


@pytest.mark.parametrize("robots", [0, -1, 151])
def test_a_fleet_that_the_addresses_do_not_hold_is_refused(robots: int) -> None:
    with pytest.raises(ContainerError, match="1 to 150"):
        compose_text(SHIPPED, robots)


def test_the_command_needs_nothing_but_python() -> None:
    """The command needs neither a workspace nor any installed package."""
    script = "import sys; sys.path.insert(0, sys.argv[1]); import containers.__main__"
    command = ["/usr/bin/python3", "-I", "-S", "-c", script, str(DOCKER.parent / "tools")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_image_takes_no_checks_from_pypi() -> None:
    assert [one.split("==")[0] for one in requirements()] == ["pybullet", "google-re2", "xacro"]


def test_long_stages_of_the_image_are_made_each_from_a_file_of_its_own() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    for stage in ("packages", "build"):
        selected = selected_stages(text, "inputs", stage)
        assert selected.startswith("# The fleet's image")
        assert re.findall(r"^(?:ARG|FROM) .*", selected, re.M)[:3] == [
            "ARG BASE=debian:bookworm-slim",
            "FROM ${BASE} AS inputs",
            f"FROM ${{BASE}} AS {stage}",
        ]
        assert set(re.findall(r"--from=(\S+)", selected)) == {"inputs"}


def test_the_image_is_built_on_no_other_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image, "_label", lambda name: "")
    for name in ("run_step", "say"):
        monkeypatch.setattr(image, name, lambda *_: pytest.fail("nothing is to be tried"))
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(
        ContainerError,
        match=r"^the image pioneer is built on x86-64 only; this machine is aarch64$",
    ):
        image.ensure_image("pioneer")


def test_without_a_python_in_the_usual_places_the_one_that_runs_fetches_wheels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Path, "exists", lambda path: False)
    assert image._python() == Path(sys.executable)


def test_a_download_that_is_killed_leaves_no_wheel_among_the_whole_ones(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def killed(command: Sequence[str]) -> None:
        Path(command[command.index("-d") + 1], "one-1.0-py3-none-any.whl").write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr(image, "WHEELS", tmp_path / "wheels")
    monkeypatch.setattr(image, "LOG", tmp_path / "image.log")
    monkeypatch.setattr(image, "requirements", lambda: ["one==1.0"])
    monkeypatch.setattr(image, "run_step", killed)
    image.WHEELS.mkdir()
    with pytest.raises(KeyboardInterrupt):
        image._ensure_wheels()
    assert list(image.WHEELS.iterdir()) == []


@pytest.mark.parametrize(
    ("screen", "page", "well"), [("$$", "$$", True), ("$$", "$dead", False), ("$dead", "$$", False)]
)
def test_the_desktop_is_up_while_both_screen_and_page_run(
    screen: str, page: str, well: int
) -> None:
    (function,) = re.findall(r"^up\(\).*$", (DOCKER / "desktop").read_text(), re.M)
    function = function.replace("/sys/class/net/eth0", "/")
    script = f"true & dead=$!; wait; screen={screen} page={page}; {function}; up"
    done = subprocess.run(["bash", "-uc", script], capture_output=True, text=True, check=False)
    assert (done.returncode == 0, done.stderr) == (well, "")


def test_a_computer_that_says_nothing_still_has_its_row() -> None:
    dead = Computer("aadi1", "c", "exited", "", {}, "i")
    heading, row = status_table([dead], {}).splitlines()
    assert row.split() == ["aadi1", "exited", *["-"] * 7]
    assert heading.startswith("COMPUTER  CONTAINER")


def test_a_step_that_fails_is_reported_with_its_last_lines_and_its_log(tmp_path: Path) -> None:
    step = tmp_path / "step"
    step.write_text("#!/bin/bash\necho a clue\nexit 1\n")
    step.chmod(0o755)
    with pytest.raises(ContainerError, match=r"step failed:\na clue\nthe whole log is .*/log$"):
        run_step([str(step)], tmp_path / "log")


def test_report_is_forked_by_a_program_of_the_image() -> None:
    forked, _ = REPORT
    assert os.access(forked.replace("/opt/pioneer", str(DOCKER.parent)), os.X_OK)
    assert "PIONEER_FORK_SOCKET: /run/" in SHIPPED


def test_an_idle_computer_says_that_no_server_will_listen(tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with subprocess.Popen(
        ["bash", DOCKER / "computer", "idle"], env={**os.environ, "PIONEER_FORK_SOCKET": str(path)}
    ) as idle:
        try:
            wait_until(path.is_file, "the file", 60.0)
        finally:
            idle.terminate()


@pytest.mark.parametrize(
    ("role", "program", "words"),
    [
        ("base", "pioneer_launch/computer", "2"),
        ("robot", "pioneer_gazebo/run-pioneer-nav-local", "1"),
    ],
)
def test_a_computer_starts_its_two_steps(
    tmp_path: Path, role: str, program: str, words: str
) -> None:
    started = tmp_path / "catkin_ws" / "devel" / "lib" / program
    started.parent.mkdir(parents=True)
    started.write_text('#!/bin/sh\necho "$#"\n')
    started.chmod(0o755)
    (tmp_path / "docker").mkdir()
    script = shutil.copy(DOCKER / "computer", tmp_path / "docker")
    done = subprocess.run(["bash", script, role], capture_output=True, text=True, check=False)
    assert done.stdout == f"{words}\n"
