"""Which processes a command waits for before it starts its own: those of commands that were killed."""

import os
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from pioneer_demo.error import DemoError
from pioneer_demo.processes import leftover
from pioneer_demo.processes.leftover import await_leftovers, leftovers, mark
from pioneer_harness.proc import arguments
from pioneer_harness.wait import wait_until

COMMAND = """
import os, subprocess, sys
from pioneer_demo.processes.leftover import mark
variable, *argv = sys.argv[1:]
child = subprocess.Popen(argv, env={**os.environ, variable: mark()}, stdout=subprocess.DEVNULL)
print(child.pid, flush=True)
sys.stdin.read()
"""
STUBBORN = ("bash", "-c", "trap '' TERM; while :; do sleep 1; done")
TIMEOUT = 20.0


class Command:
    """A command that has started a process."""

    def __init__(self, *argv: str) -> None:
        path = os.pathsep.join(filter(None, sys.path))
        self._process = subprocess.Popen(
            [sys.executable, "-c", COMMAND, leftover.VARIABLE, *argv],
            env={**os.environ, "PYTHONPATH": path},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.child = int(self._process.stdout.readline())

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()

    def end(self) -> None:
        if self._process.returncode is None:
            self.kill()
        try:
            os.kill(self.child, 9)
        except ProcessLookupError:
            return


@pytest.fixture(autouse=True)
def own_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests' fleets, on the same machine at the same time, are not touched."""
    monkeypatch.setattr(leftover, "VARIABLE", f"PIONEER_TEST_{uuid.uuid4().hex}")


@pytest.fixture
def command() -> Iterator[Command]:
    made = Command(*STUBBORN)
    yield made
    made.end()


def test_processes_of_a_command_that_runs_are_left_alone(command: Command) -> None:
    assert command.child not in leftovers()


def test_processes_of_a_killed_command_are_found_and_waited_for(command: Command) -> None:
    command.kill()
    wait_until(lambda: command.child in leftovers(), "the process without its command", TIMEOUT)
    said: list[str] = []
    began = time.monotonic()
    await_leftovers(said.append, lambda: None, grace=0.5)
    assert time.monotonic() - began >= 0.5
    assert len(said) == 1
    assert "of a killed command to end" in said[0]
    assert not Path(f"/proc/{command.child}/exe").exists()


def test_the_wait_ends_when_the_user_wants_it_to(command: Command) -> None:
    command.kill()
    wait_until(lambda: command.child in leftovers(), "the process without its command", TIMEOUT)

    def interrupted() -> None:
        raise DemoError("Ctrl-C")

    with pytest.raises(DemoError):
        await_leftovers(lambda line: None, interrupted)
    assert Path(f"/proc/{command.child}/exe").exists()


def test_nothing_is_said_where_nothing_is_left() -> None:
    said: list[str] = []
    await_leftovers(said.append, lambda: None)
    assert said == []


@pytest.mark.parametrize("value", ["", "pid:[1]:999999:1", mark()])
def test_processes_of_other_namespaces_and_of_this_command_are_no_leftovers(value: str) -> None:
    environment = {**os.environ, leftover.VARIABLE: value}
    with subprocess.Popen(["sleep", "60"], env=environment) as other:
        wait_until(lambda: arguments(other.pid)[:1] == ("sleep",), "its start", TIMEOUT)
        found = leftovers()
        other.kill()
    assert other.pid not in found
