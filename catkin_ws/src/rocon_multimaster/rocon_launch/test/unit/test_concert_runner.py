"""Launches run side by side, each on its own master, and none of their processes survives the end."""

import os
import signal
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from pioneer_harness.wait import wait_until
from rocon_launch import concert_runner
from rocon_launch.concert import Launch
from rocon_launch.concert_runner import ConcertRunner

ROSLAUNCH = """#!/bin/bash
# Does what the launch file's name says, in place of roslaunch.
echo "$ROS_MASTER_URI ${ROS_NAMESPACE-none} $*"
for word; do case $word in
  ends) exit 0 ;;
  fails) exit 3 ;;
  stays) echo $$ >"$PIDS"; exec sleep 100 ;;
  stubborn) trap '' INT; sleep 100 & echo $$ >"$PIDS"; echo $! >>"$PIDS"; while :; do wait; done ;;
esac; done
"""


@pytest.fixture
def pids(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Replaces roslaunch by the script; returns the file to which it writes its PIDs."""
    program = tmp_path / "roslaunch"
    program.write_text(ROSLAUNCH)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setenv("PIDS", str(tmp_path / "pids"))
    before = {
        number: signal.getsignal(number)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    yield tmp_path / "pids"
    for number, handler in before.items():
        signal.signal(number, handler)


def launch(name: str, port: int = 11311, **fields: object) -> Launch:
    return Launch("some_package", name, port, name, {"robots": "2"}, **fields)


def interrupt_once(condition: Path) -> threading.Thread:
    """Interrupts this process once the file has been written."""

    def wait_and_interrupt() -> None:
        wait_until(
            lambda: condition.exists() and condition.read_text().endswith("\n"), "the launch", 30
        )
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=wait_and_interrupt)
    thread.start()
    return thread


def test_each_launch_has_its_master_and_its_arguments(pids, capsys, monkeypatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://base:11311/")
    monkeypatch.setenv("ROS_NAMESPACE", "mine")
    first, second = launch("ends", 11311), launch("ends", 11312, waits=True)
    assert ConcertRunner([first, second], screen=True).run() == 0
    lines = capsys.readouterr().out.splitlines()
    assert (
        "[ends] http://base:11311 none --no-summary --screen -p 11311 some_package ends robots:=2"
        in lines
    )
    assert (
        "[ends] http://base:11312 none --no-summary --screen --wait -p 11312 some_package ends robots:=2"
        in lines
    )
    assert sum(line.startswith("[ends] has ended after") for line in lines) == 2


def test_the_first_failure_is_the_status(pids) -> None:
    assert ConcertRunner([launch("ends"), launch("fails")], screen=False).run() == 3


@pytest.mark.parametrize(("name", "status"), [("ends", 1), ("fails", 3)])
def test_the_end_of_a_required_launch_ends_all(pids, capsys, name, status) -> None:
    assert (
        ConcertRunner([launch("stays"), launch(name, required=True)], screen=False).run() == status
    )
    assert "everything ends with it" in capsys.readouterr().out
    assert not psutil.pid_exists(int(pids.read_text()))


def test_a_launch_that_respawns_is_started_again(pids, capsys, monkeypatch) -> None:
    """The second run ends too soon after its start, which ends the concert."""
    lives = iter([20.0, 0.5])
    monkeypatch.setattr(
        concert_runner.RoslaunchProcess, "lived", property(lambda _self: next(lives))
    )
    assert ConcertRunner([launch("ends", respawn=True)], screen=False).run() == 1
    said = capsys.readouterr().out
    assert "has ended after 20 s; starting it again" in said
    assert said.count("some_package ends robots:=2") == 2


def test_an_interrupt_ends_the_launches_with_status_0(pids) -> None:
    thread = interrupt_once(pids)
    assert ConcertRunner([launch("stays")], screen=False).run() == 0
    thread.join()
    assert not psutil.pid_exists(int(pids.read_text()))


def test_what_ignores_the_interrupt_is_killed_with_its_children(pids, monkeypatch) -> None:
    monkeypatch.setattr(concert_runner, "GENTLE", 0.3)
    thread = interrupt_once(pids)
    began = time.monotonic()
    assert ConcertRunner([launch("stubborn")], screen=False).run() == 0
    thread.join()
    assert time.monotonic() - began < 30
    wait_until(
        lambda: not any(map(psutil.pid_exists, map(int, pids.read_text().split()))), "their end", 10
    )
