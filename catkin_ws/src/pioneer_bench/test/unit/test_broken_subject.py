"""Benches fail what is broken."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from pioneer_bench.adapters.fleet import cpu
from pioneer_bench.nodes.world import CLOSE, MOST_WRONG, are_true, range_errors

NEAREST, FARTHEST = 0.1, 30.0


@pytest.fixture
def truth() -> np.ndarray:
    """Distances as in a hall [m]; one beam in ten leaves through a door."""
    ranges = np.random.default_rng(1).uniform(0.5, 25.0, 1000)
    ranges[::10] = np.inf
    return ranges


def errors(ranges: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return range_errors(ranges, truth, NEAREST, FARTHEST)


def test_a_true_laser_holds(truth: np.ndarray) -> None:
    found = errors(truth.copy(), truth)
    assert found.size == 900
    assert are_true(found)


@pytest.mark.parametrize("blind", [np.inf, np.nan, -np.inf])
def test_a_blind_laser_fails(truth: np.ndarray, blind: float) -> None:
    assert not are_true(errors(np.full(truth.shape, blind), truth))


def test_a_laser_that_is_blind_in_one_direction_fails(truth: np.ndarray) -> None:
    ranges = truth.copy()
    ranges[100:200] = np.inf
    assert not are_true(errors(ranges, truth))


def test_a_laser_that_sees_what_is_not_there_fails(truth: np.ndarray) -> None:
    ranges = np.where(np.isfinite(truth), truth, 3.0)
    assert not are_true(errors(ranges, truth))


def test_a_laser_that_measures_too_far_fails(truth: np.ndarray) -> None:
    assert not are_true(errors(truth + 2 * CLOSE, truth))


def test_no_beam_at_all_proves_nothing() -> None:
    assert not are_true(np.empty(0))


def test_a_few_beams_that_graze_an_edge_are_allowed(truth: np.ndarray) -> None:
    ranges = truth.copy()
    ranges[1 : 1 + int(MOST_WRONG * 900)] += 1.0
    assert are_true(errors(ranges, truth))


def work(seconds: float) -> None:
    while time.thread_time() < seconds:
        pass


def test_the_cpu_time_of_threads_that_have_ended_is_counted() -> None:
    before = cpu([os.getpid()])
    own = time.process_time()
    workers = [threading.Thread(target=work, args=(0.2,)) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert cpu([os.getpid()]) - before >= 0.6
    assert cpu([os.getpid()]) - before == pytest.approx(time.process_time() - own, abs=0.01)


def test_the_cpu_time_of_another_process_is_read() -> None:
    text = "import sys, time\nwhile time.process_time() < 0.3: pass\nprint(flush=True)\nsys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", text], stdin=-1, stdout=-1) as other:
        assert other.stdout is not None
        other.stdout.readline()
        assert 0.3 <= cpu([other.pid]) < 0.4
        other.kill()
        other.wait()
        with pytest.raises(OSError, match="Invalid argument"):
            cpu([other.pid])
