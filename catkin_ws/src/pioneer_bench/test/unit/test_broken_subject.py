"""Benches fail what is broken."""

import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pioneer_bench.accuracy import Worlds
from pioneer_bench.adapters.description import pioneer_urdf
from pioneer_bench.adapters.fleet import cpu
from pioneer_bench.core.accuracy import MOTIONS, laser_rows, motion_rows, standstill_rows
from pioneer_bench.core.ride import Ride
from pioneer_bench.core.row import Row
from pioneer_bench.hard import _rows as hard_rows
from pioneer_bench.lockstep import _rows as lockstep_rows
from pioneer_bench.nodes.world import CLOSE, MOST_WRONG, are_true, range_errors
from pioneer_bench.traffic import Result
from pioneer_bench.traffic import _rows as traffic_rows
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.urdf import robot_from_urdf

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


@pytest.fixture
def worlds() -> Iterator[Worlds]:
    with Worlds() as worlds:
        yield worlds


def missed(rows: Iterable[Row]) -> list[str]:
    return [row.what for row in rows if row.holds is False]


def broken(monkeypatch: pytest.MonkeyPatch, method: str, change: Callable[..., Any]) -> None:
    """Changes what a method of the simulation returns."""
    whole = getattr(Simulation, method)
    monkeypatch.setattr(Simulation, method, lambda self, *words: change(self, whole(self, *words)))


@pytest.mark.parametrize("factor", [1.01, np.inf, np.nan])
def test_the_accuracy_bench_fails_a_laser_that_is_wrong_or_blind(
    worlds: Worlds, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    broken(monkeypatch, "ranges", lambda _, ranges: ranges * factor)
    assert missed(laser_rows(worlds.make, robot_from_urdf(pioneer_urdf())))


def test_the_accuracy_bench_fails_odometry_and_motion_that_are_wrong(
    worlds: Worlds, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, name = robot_from_urdf(pioneer_urdf()), "straight, 6 m at 1.2 m/s"
    broken(monkeypatch, "odometry", lambda _, odometry: replace(odometry, x=1.01 * odometry.x))
    rows = list(motion_rows(worlds.make, robot, name, MOTIONS[name]))
    assert missed(rows) == [f"{name}: odometry from truth"]


def test_the_accuracy_bench_fails_a_robot_that_drifts(
    worlds: Worlds, monkeypatch: pytest.MonkeyPatch
) -> None:
    def drifted(simulation: Simulation, pose: Pose) -> Pose:
        seconds = simulation.tick / TICK_RATE
        return pose.compose(Pose((1e-4 * seconds, 0.0, 0.0)))

    broken(monkeypatch, "pose", drifted)
    assert missed(standstill_rows(worlds.make, robot_from_urdf(pioneer_urdf())))


GOOD_RIDE = Ride(goals=4, reachable=4, reached=4, seconds=60.0, way=40.0, clearance=0.3, turned=6.0)


@pytest.mark.parametrize(
    "worse", [{"reached": 3}, {"contacts": 1}, {"stuck": True}], ids=lambda worse: next(iter(worse))
)
def test_the_bench_of_hard_courses_fails_one_bad_ride_among_good_ones(
    worse: dict[str, Any],
) -> None:
    assert missed(hard_rows("corner", [GOOD_RIDE] * 5)) == []
    rides = [*[GOOD_RIDE] * 4, replace(GOOD_RIDE, **worse)]
    assert missed(hard_rows("corner", rides))


GOOD_TRIAL = Result("utm_0", 4, 0, 3, 12, 12, 0, 0.5, 100.0, 200.0, 60.0, 80.0)


@pytest.mark.parametrize("worse", [{"reached": 11}, {"contacts": 1}], ids=["missed", "contact"])
def test_the_traffic_bench_fails_one_bad_trial_among_good_ones(worse: dict[str, Any]) -> None:
    assert missed(traffic_rows([GOOD_TRIAL] * 5)) == []
    assert missed(traffic_rows([*[GOOD_TRIAL] * 4, replace(GOOD_TRIAL, **worse)]))


GOOD_DEMO = {
    "real_time_factor": 3.0,
    "cpu_seconds_per_simulated_second": 0.5,
    "missed": 0,
    "stale": 0,
    "bytes": "same",
}


@pytest.mark.parametrize("worse", [{"missed": 1}, {"stale": 1}, {"bytes": "other"}])
def test_the_lockstep_bench_fails_one_bad_demo_among_good_ones(worse: dict[str, Any]) -> None:
    assert missed(lockstep_rows(2, [GOOD_DEMO] * 5)) == []
    assert missed(lockstep_rows(2, [*[GOOD_DEMO] * 4, {**GOOD_DEMO, **worse}]))


@pytest.mark.parametrize("samples", [(1.0, math.nan), (math.nan, 1.0), (1.0, math.nan, 1.0)])
@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize("at_least", [False, True])
def test_a_sample_that_is_no_number_misses_every_goal(
    samples: tuple[float, ...], every: bool, at_least: bool
) -> None:
    assert Row("x", "m", samples, 1.0, at_least, every=every).holds is False
