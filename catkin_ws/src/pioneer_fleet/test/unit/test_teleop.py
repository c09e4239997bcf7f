"""How teleop ends: the robot stops first."""

import os
import pty
import signal
import subprocess
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.wait import wait_until

PATIENCE = 30.0


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, "q"])
def test_every_way_to_end_teleop_stops_the_robot(
    tmp_path: Path, ending: signal.Signals | str
) -> None:
    heard = tmp_path / "heard"
    shown = tmp_path / "shown"
    keyboard, theirs = pty.openpty()
    with Master() as master, heard.open("w") as commands, shown.open("w") as output:
        environment = {**os.environ, **master.environment, "PYTHONUNBUFFERED": "1"}
        listener = subprocess.Popen(
            ["rostopic", "echo", "-p", "/pioneer1/cmd_vel/linear/x"],
            env=environment,
            stdout=commands,
        )
        teleop = subprocess.Popen(
            ["rosrun", "pioneer_fleet", "teleop", "pioneer1"],
            env=environment,
            stdin=theirs,
            stdout=output,
        )
        os.write(keyboard, b"w")
        try:
            wait_until(lambda: ",0.1" in heard.read_text(), "the command to drive", PATIENCE)
            if isinstance(ending, str):
                os.write(keyboard, ending.encode())
            else:
                teleop.send_signal(ending)
            status = teleop.wait(PATIENCE)
            wait_until(
                lambda: heard.read_text().endswith(",0.0\n"), "the command to stop", PATIENCE
            )
        finally:
            for process in (teleop, listener):
                process.kill()
                process.wait()
    assert status == (0 if isinstance(ending, str) else 128 + ending)
    assert shown.read_text().endswith("+0.0 m/s  +0.0 rad/s\n")
