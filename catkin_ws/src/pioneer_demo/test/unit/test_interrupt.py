"""Signals end a command in any case: the first in order, the second whatever its threads do."""

import signal
import subprocess
import sys

import pytest

BLOCKED = """
import threading
from pioneer_demo.console.interrupt import Interrupt
Interrupt()
print("ready", flush=True)
lock = threading.Lock()
lock.acquire()
lock.acquire()
"""
IN_ORDER = """
from pioneer_demo.console.interrupt import Interrupt, Interrupted
interrupt = Interrupt()
print("ready", flush=True)
try:
    while True:
        interrupt.wait(1.0)
        interrupt.check()
except Interrupted as end:
    raise SystemExit(end.status)
"""


@pytest.fixture
def started():
    processes = []

    def start(program):
        process = subprocess.Popen(
            [sys.executable, "-c", program],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        assert process.stdout.readline() == "ready\n"
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_second_signal_ends_a_command_that_is_blocked(started, number):
    process = started(BLOCKED)
    process.send_signal(number)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.5)
    process.send_signal(number)
    assert process.wait(30) == 128 + number
    assert "ended by the second signal" in process.stderr.read()


def test_the_first_signal_ends_a_command_in_order(started):
    process = started(IN_ORDER)
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 128 + signal.SIGINT
    assert process.stderr.read() == ""
