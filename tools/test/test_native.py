"""``./pioneer status`` shows every fleet of the machine, whether it runs as processes or in containers."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest

import native
from containers.engine import Computer

FLEET = {
    "world": "utm_0", "phase": "up", "started": 0.0, "real_time_factor": 1.0, "master": "http://localhost:11312",
    "pid": 7, "faults": [], "age": 0.5,
    "robots": [
        {
            "robot": "rover", "state": "waiting", "pose": [1.0, 2.0, 0.0], "localisation_error": 0.01, "aborted": 0,
            "moving": False, "speed": 0.0, "odom_age": 0.1, "reached": 1, "received": 2, "waypoint": "", "master": "",
        }
    ],
}  # fmt: skip


class FakeProject:
    def computers(self) -> list[Computer]:
        return [Computer("aadi1", "c1", "running", "", {}, "pioneer")]


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> None:
    def follow(asked: Any, heard: Any) -> None:
        for computer, _ in asked:
            heard(computer, {"computer": computer.name, "stage": "moving", "lacks": ""})

    monkeypatch.setattr(native, "running_fleets", lambda: [FLEET])
    monkeypatch.setattr(native, "_has_containers", lambda _: True)
    monkeypatch.setattr(native, "fleet_of", lambda _: FakeProject())
    monkeypatch.setattr(native, "follow", follow)


@pytest.mark.usefixtures("both")
def test_json_has_the_fleets_of_processes_and_the_computers_in_one_document(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert native.main(["status", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert [robot["robot"] for fleet in shown["fleets"] for robot in fleet["robots"]] == ["rover"]
    assert shown["computers"]["aadi1"]["stage"] == "moving"


@pytest.mark.usefixtures("both")
def test_the_table_has_both(capsys: pytest.CaptureFixture[str]) -> None:
    assert native.main(["status"]) == 0
    text = capsys.readouterr().out
    assert "rover" in text
    assert "aadi1" in text


@pytest.mark.usefixtures("both")
def test_a_fault_of_a_fleet_is_a_line_below_its_robots_and_the_exit_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fault = "rover/amcl keeps dying and is started again: 3 times so far, exit code 1"
    monkeypatch.setattr(native, "running_fleets", lambda: [{**FLEET, "faults": [fault]}])
    assert native.main(["status"]) == 1
    assert f"\n{fault}\n" in capsys.readouterr().out


@pytest.mark.usefixtures("both")
def test_rviz_without_a_display_is_refused_with_the_command_for_a_picture(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    assert native.main(["rviz"]) == 1
    told = capsys.readouterr().err
    assert "DISPLAY is not set" in told
    assert (
        "ROS_MASTER_URI=http://localhost:11312 ./pioneer run rosrun pioneer_description rviz_snapshot"
        in told
    )


OTHER = {
    **FLEET,
    "pid": 8,
    "master": "http://localhost:12312",
    "robots": [{**FLEET["robots"][0], "robot": "scout", "master": "http://localhost:12313"}],
}


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, list[str]]]:
    """Two fleets, and the commands that would be run: master and words."""
    begun: list[tuple[str, list[str]]] = []
    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setattr(native, "running_fleets", lambda: [FLEET, OTHER])

    def become(*started: Any) -> NoReturn:
        begun.append(started)
        raise SystemExit

    monkeypatch.setattr(native, "_become", become)
    return begun


def test_with_two_fleets_rviz_asks_for_one_and_lists_them(
    two: list[tuple[str, list[str]]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert native.main(["rviz"]) == 1
    told = capsys.readouterr().err
    assert "2 fleets run; choose one: --fleet 7: rover in utm_0" in told
    assert "--fleet 8: scout in utm_0" in told
    with pytest.raises(SystemExit):
        native.main(["rviz", "--fleet", "8"])
    assert [master for master, _ in two] == ["http://localhost:12312"]
    assert native.main(["rviz", "--fleet", "9"]) == 1
    assert "no fleet has the process 9" in capsys.readouterr().err


@pytest.mark.usefixtures("two")
def test_status_shows_both_fleets_or_the_one_that_is_chosen(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(native, "_has_containers", lambda _: False)
    assert native.main(["status"]) == 0
    text = capsys.readouterr().out
    assert "rover" in text
    assert "scout" in text
    assert native.main(["status", "--fleet", "8"]) == 0
    text = capsys.readouterr().out
    assert "scout" in text
    assert "rover" not in text
    assert native.main(["status", "--fleet", "9", "--json"]) == 1
    assert "no fleet has the process 9; there are --fleet 7: rover" in capsys.readouterr().err


def test_teleop_finds_the_only_fleet_with_that_robot(
    two: list[tuple[str, list[str]]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        native.main(["teleop", "scout"])
    assert [master for master, _ in two] == ["http://localhost:12313"]
    monkeypatch.setattr(native, "running_fleets", lambda: [OTHER, {**OTHER, "pid": 9}])
    assert native.main(["teleop", "scout"]) == 1
    assert "choose one" in capsys.readouterr().err


def test_a_reader_that_ends_early_gets_no_traceback() -> None:
    program = "import native, test_native as t\nnative.running_fleets = lambda: [t.FLEET] * 999\n"
    piped = 'python3 -c "$0" | true; exit ${PIPESTATUS[0]}'
    folders = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    words = ["bash", "-c", piped, program + "raise SystemExit(native.main(['status']))"]
    done = subprocess.run(
        words, env={**os.environ, "PYTHONPATH": folders}, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (1, b"")


def test_without_a_fleet_one_line_says_how_to_start_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(native, "running_fleets", list)
    monkeypatch.setattr(native, "_has_containers", lambda _: False)
    assert native.main(["status", "--json"]) == 1
    assert capsys.readouterr().err.startswith("pioneer: no fleet runs: ./pioneer fleet starts one")


@pytest.mark.usefixtures("both")
def test_figures_that_are_no_longer_written_are_said_to_be_old(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(native, "running_fleets", lambda: [{**FLEET, "age": 1200.0}])
    assert native.main(["status"]) == 1
    text = capsys.readouterr().out
    assert "these figures are 1200 s old: pid 7" in text
    assert "1200.10 s" in text


def test_nothing_of_a_status_file_controls_the_terminal() -> None:
    text = native.fleet_table(
        {**FLEET, "world": "\x1b]0;title\x07", "faults": ["\x9b31mred", "\u202egnirts"]}
    )
    assert all(char.isprintable() or char == "\n" for char in text)
    assert "\\x1b]0;title" in text
