"""Waits for processes in place of roslaunch's monitor, but returns as soon as something happens."""

import errno
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from pioneer_launch import process_watch
from pioneer_launch.process_end import await_end
from pioneer_launch.process_watch import LONGEST, ProcessWatch
from pioneer_node.adapters.end_request import EndRequest

PATIENCE = 20.0


class Monitor(threading.Thread):
    """A thread with processes, like roslaunch's monitor, that waits once."""

    def __init__(self, watch: ProcessWatch, *popens: Any, seconds: float = 0.1) -> None:
        super().__init__(daemon=True)
        self.procs = [SimpleNamespace(popen=one) for one in popens]
        self.waited = 0.0
        self._wait: Callable[[], None] = lambda: watch.sleep(seconds)

    def run(self) -> None:
        began = time.monotonic()
        self._wait()
        self.waited = time.monotonic() - began


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["sleep", "1000"]) as process:
        yield process
        process.kill()


def test_the_end_of_a_process_ends_the_wait(sleeper: subprocess.Popen[bytes]) -> None:
    with subprocess.Popen(["sleep", "0.3"]) as short:
        monitor = Monitor(ProcessWatch(), sleeper, short)
        monitor.start()
        monitor.join(PATIENCE)
        assert 0.1 < monitor.waited < LONGEST


def test_nothing_happens_and_the_wait_has_an_end(sleeper: subprocess.Popen[bytes]) -> None:
    monitor = Monitor(ProcessWatch(), sleeper)
    monitor.start()
    monitor.join(PATIENCE)
    assert LONGEST * 0.9 < monitor.waited < PATIENCE


def test_a_ring_ends_all_waits_and_one_before_it_the_next(sleeper: subprocess.Popen[bytes]) -> None:
    watch = ProcessWatch()
    ring = watch.then_ring(lambda: "rung")
    for _ in range(3):
        monitors = [Monitor(watch, sleeper), Monitor(watch)]
        for one in monitors:
            one.start()
        while any(one.is_alive() for one in monitors):
            assert ring() == "rung"
        assert all(one.waited < LONGEST for one in monitors)


def test_a_method_that_fails_rings_all_the_same(sleeper: subprocess.Popen[bytes]) -> None:
    watch = ProcessWatch()

    def fail() -> None:
        raise ValueError("no")

    monitor = Monitor(watch, sleeper)
    monitor.start()
    while monitor.is_alive():
        with pytest.raises(ValueError, match="no"):
            watch.then_ring(fail)()
    assert monitor.waited < LONGEST


def test_a_process_that_is_not_started_or_is_to_start_again_is_looked_at_as_often_as_before() -> (
    None
):
    ended = subprocess.Popen(["true"])
    ended.wait()
    for popen in (None, ended):
        monitor = Monitor(ProcessWatch(), popen, seconds=0.05)
        monitor.start()
        monitor.join(PATIENCE)
        assert 0.04 < monitor.waited < LONGEST


def test_an_end_that_is_not_reported_yet_does_not_turn_the_wait_into_a_busy_loop() -> None:
    with subprocess.Popen(["true"]) as unreported:
        watch = ProcessWatch()
        Monitor(watch, unreported).run()
        began = time.monotonic()
        for _ in range(20):
            monitor = Monitor(watch, unreported)
            monitor.start()
            monitor.join(PATIENCE)
        assert time.monotonic() - began > 0.1


def test_a_lack_of_descriptors_is_polled_through(
    sleeper: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It raised an exception in roslaunch's monitor, which ended; no node was started again from then on."""

    def no_descriptor(_pid: int) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "pidfd_open", no_descriptor)
    monitor = Monitor(ProcessWatch(), sleeper, seconds=0.05)
    monitor.start()
    monitor.join(PATIENCE)
    assert 0.05 <= monitor.waited < LONGEST


def test_a_computer_without_descriptors_polls_its_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The exception ended it, and its steps were left running."""

    def no_descriptor(_pid: int) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "pidfd_open", no_descriptor)
    began = time.monotonic()
    await_end([os.getpid()], EndRequest(), 0.0)
    assert 0.09 < time.monotonic() - began < PATIENCE


def test_roslaunchs_monitor_survives_an_exception_of_every_call_it_makes(
    sleeper: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """roslaunch has no handler around its wait, which is replaced here."""
    calls, failing = 0, 0

    def injected(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls == failing:
                raise RuntimeError("as asked")
            return function(*arguments, **named)

        return call

    end_request = EndRequest()
    end_request.wake()
    monkeypatch.setattr(process_watch, "EndRequest", injected(lambda: end_request))
    monkeypatch.setattr(end_request, "wait", injected(end_request.wait))
    monkeypatch.setattr(os, "pidfd_open", injected(os.pidfd_open))
    popen = SimpleNamespace(poll=injected(sleeper.poll), pid=sleeper.pid)

    def run(watch: ProcessWatch) -> Monitor:
        monitor = Monitor(watch, popen, seconds=0.05)
        monitor.start()
        monitor.join(PATIENCE)
        assert not monitor.is_alive()
        return monitor

    run(ProcessWatch())
    complete = calls
    assert complete == 4
    for number in range(1, complete + 1):
        calls, failing, watch = 0, number, ProcessWatch()
        assert run(watch).waited >= 0.05
        calls = complete
        end_request.wake()
        assert 0 < run(watch).waited < LONGEST
        assert calls >= complete + 3
