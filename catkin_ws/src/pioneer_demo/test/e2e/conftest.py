"""Starts demos and fleets as a user does, with their own commands."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pioneer_harness.proc import arguments, has_variable, process_states
from pioneer_harness.wait import wait_until

sys.path.insert(0, str(Path(__file__).parent))

_MARK = "PIONEER_DEMO_TEST"
_CTRL_C = 5.0
_FOREIGN = {
    "ROS_NAMESPACE": "/elsewhere",
    "ROS_HOSTNAME": "no-such-host.invalid",
    "GATEWAY_NETWORK_INTERFACE": "eth9",
}
"""Variables that a user's shell may have set for another fleet; every demo of these tests runs with them."""


def python_path():
    """Returns the PYTHONPATH of programs that tests start: this process's, the built packages first.

    The import of a built package puts the folder of its sources first, which lacks the generated messages.
    """
    built = [path for path in sys.path if "/devel/" in path]
    return os.pathsep.join([*built, *filter(None, sys.path)])


class Running:
    """A demo or fleet in its own session; an environment variable marks all processes that it started.

    `prefix` is a command that runs it, and `variables` are further variables of its environment.
    """

    def __init__(self, report, command, *options, prefix=(), output=None, **variables):
        self.report, self.command = report, command
        self.mark = str(report)
        self.output = output or report.with_suffix(".txt")
        self.python_path = python_path()
        environment = {
            **os.environ,
            **_FOREIGN,
            _MARK: self.mark,
            "PYTHONPATH": self.python_path,
            **variables,
        }
        folder = ["--log" if command == "fleet" else "--report", str(report)]
        module = [sys.executable, "-m", "pioneer_demo"]
        command = [*prefix, *module, command, *folder, *map(str, options)]
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                command,
                env=environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def text(self):
        return self.output.read_text(errors="replace")

    def processes(self):
        """Returns the command line of each live process that carries the mark, by PID."""
        marked = (
            pid
            for pid, state in process_states().items()
            if state.alive and has_variable(pid, _MARK, self.mark)
        )
        return {pid: " ".join(arguments(pid)) for pid in marked}

    def await_words(self, words, timeout):
        def said():
            assert self.process.poll() is None, f"it ended too early:\n{self.text()}"
            return words in self.text()

        wait_until(said, f"'{words}' in its output", timeout)

    def interrupt(self, number=signal.SIGINT):
        """Ends the command with a signal and checks that no process is left."""
        self.process.send_signal(number)
        began = time.monotonic()
        assert self.process.wait(3 * _CTRL_C) == 128 + number, self.text()
        assert time.monotonic() - began <= _CTRL_C
        assert self.processes() == {}
        # After SIGHUP the terminal is closed, and nothing may be written to it.
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

    def begin(*options, command="demo", below=tmp_path, **how):
        report = below / f"report{len(running)}"
        running.append(Running(report, command, *options, **how))
        return running[-1]

    yield begin
    for one in running:
        one.end()
