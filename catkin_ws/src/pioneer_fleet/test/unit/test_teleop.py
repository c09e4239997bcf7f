"""How teleop ends: the robot stops first."""

import os
import pty
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_fleet.recording.recording import writer_of
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


@pytest.mark.parametrize("command", ["teleop", "replay"])
def test_the_second_ctrl_c_ends_a_command_that_hangs(tmp_path: Path, command: str) -> None:
    """Its master, or its disk, does not answer: it can neither register nor unregister."""
    _keyboard, theirs = pty.openpty()
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen(16)
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}"
        if command == "teleop":
            argv = ["rosrun", "pioneer_fleet", "teleop", "pioneer1"]
        else:
            recording = tmp_path / "x.bag"
            writer_of(recording).close()
            code = (
                "import sys, threading\n"
                "from pioneer_fleet.recording import replay\n"
                "def hangs(*_):\n    print('hangs', flush=True)\n"
                "    lock = threading.Lock()\n    lock.acquire()\n    lock.acquire()\n"
                "replay.messages_of = hangs\n"
                f"sys.exit(replay.main(['{recording}']))"
            )
            argv = [sys.executable, "-c", code]
        environment = {**os.environ, "ROS_MASTER_URI": uri, "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(
            argv, env=environment, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        try:
            if command == "teleop":
                silent.settimeout(PATIENCE)
                hung = silent.accept()
            else:
                assert process.stdout is not None
                wait_until(lambda: process.stdout.readline() == b"hangs\n", "it hangs", PATIENCE)
            process.send_signal(signal.SIGINT)
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(1.0)
            process.send_signal(signal.SIGINT)
            assert process.wait(5.0) == 128 + signal.SIGINT
            if command == "teleop":
                hung[0].close()
        finally:
            process.kill()
            process.communicate()
