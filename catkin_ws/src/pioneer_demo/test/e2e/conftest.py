"""Demos and fleets as a user starts them, by their own commands."""

import os
import signal
import subprocess
import sys
import time

import pytest

from pioneer_harness.proc import arguments, has_variable, process_states
from pioneer_harness.wait import wait_until

_MARK = "PIONEER_DEMO_TEST"
_CTRL_C = 5.0
_FOREIGN = {"ROS_NAMESPACE": "/elsewhere", "ROS_HOSTNAME": "no-such-host.invalid", "GATEWAY_NETWORK_INTERFACE": "eth9"}
"""What a user's shell may hold for another fleet: every demo here runs with it."""


class Running:
    """A demo or a fleet in a session of its own; a mark in the environment shows which processes it started."""

    def __init__(self, report, command, *options):
        self.report, self.command = report, command
        self.mark = str(report)
        self.output = report.with_suffix(".txt")
        environment = {
            **os.environ,
            **_FOREIGN,
            _MARK: self.mark,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        folder = ["--log" if command == "fleet" else "--report", str(report)]
        command = [sys.executable, "-m", "pioneer_demo", command, *folder, *map(str, options)]
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                command, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )

    def text(self):
        return self.output.read_text(errors="replace")

    def processes(self):
        """Returns the command lines of everything alive that carries the mark, by pid."""
        marked = (pid for pid, state in process_states().items() if state.alive and has_variable(pid, _MARK, self.mark))
        return {pid: " ".join(arguments(pid)) for pid in marked}

    def await_words(self, words, timeout):
        def said():
            assert self.process.poll() is None, f"it ended too early:\n{self.text()}"
            return words in self.text()

        wait_until(said, f"'{words}' in its output", timeout)

    def interrupt(self, number=signal.SIGINT):
        """Ends it by a signal, and sees that nothing is left."""
        self.process.send_signal(number)
        began = time.monotonic()
        assert self.process.wait(3 * _CTRL_C) == 128 + number, self.text()
        assert time.monotonic() - began <= _CTRL_C
        assert self.processes() == {}
        # After SIGHUP the terminal is gone, and nothing may be written to it.
        said = f"every process of this {self.command} has ended" in self.text()
        assert said == (number != signal.SIGHUP)

    def end(self):
        for pid in self.processes():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.wait()


@pytest.fixture
def start(tmp_path):
    running = []

    def begin(*options, command="demo"):
        running.append(Running(tmp_path / f"report{len(running)}", command, *options))
        return running[-1]

    yield begin
    for one in running:
        one.end()
