"""Single steps while time is paused, with and without lockstep."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from fake_engine import FakeEngine

from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.ros.mailbox import Mailbox
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import StepError, Timeline

STEP = 12
"""Of physics [ticks]."""


class FakeGate:
    """Lockstep with periods of 30 ticks; after each, time stands until `answer`."""

    def __init__(self) -> None:
        self.period = self.until = 30
        self.ended: list[int] = []
        self._waits = False

    def holds(self, tick: int) -> bool:
        assert tick <= self.until, "time has left the period"
        return self._waits

    def reached(self, tick: int) -> None:
        assert tick <= self.until, "time has left the period"
        if tick == self.until:
            self.ended.append(tick)
            self.until += self.period
            self._waits = True

    def answer(self) -> None:
        self._waits = False

    def restart(self) -> None:
        self.until = self.period


def no_mesh(mesh: object) -> None:
    raise AssertionError(f"no mesh is in this test: {mesh}")


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Timeline]:
    """Returns a function that makes a paused timeline."""
    topic = SimpleNamespace(wanted=False, send=lambda frame: None)
    monkeypatch.setattr("pioneer_gazebo.timeline.Topic", lambda *arguments: topic)

    def made(gate: Any = None) -> Timeline:
        simulation = Simulation(FakeEngine(), no_mesh, Physics())
        return Timeline(simulation, Mailbox(), 1.0, True, 100.0, lambda: None, gate)

    return made


def turn(timeline: Timeline, times: int = 20) -> None:
    for _ in range(times):
        timeline.turn(0.0)


def test_a_step_advances_by_one_physics_step_while_paused(make: Callable[..., Timeline]) -> None:
    timeline = make()
    for number in range(1, 6):
        done = timeline.request_step()
        turn(timeline)
        assert done.result(0) == timeline.tick == timeline.simulation.tick == number * STEP


def test_steps_that_are_requested_together_follow_each_other(make: Callable[..., Timeline]) -> None:
    timeline = make()
    steps = [timeline.request_step() for _ in range(3)]
    turn(timeline)
    assert [step.result(0) for step in steps] == [STEP, 2 * STEP, 3 * STEP]


def test_a_step_is_refused_while_time_runs(make: Callable[..., Timeline]) -> None:
    timeline = make()
    timeline.pause(False)
    with pytest.raises(StepError, match="while physics is paused"):
        timeline.request_step()


def test_tasks_run_at_their_ticks_in_a_step(make: Callable[..., Timeline]) -> None:
    timeline = make()
    ran: list[int] = []
    timeline.schedule.add("t", 200.0, ran.append)
    for _ in range(2):
        timeline.request_step()
        turn(timeline)
    assert ran == [3, 6, 9, 12, 15, 18, 21, 24]


def test_a_step_waits_for_the_nodes_of_a_lockstep_period(make: Callable[..., Timeline]) -> None:
    gate = FakeGate()
    timeline = make(gate)
    for _ in range(2):
        timeline.request_step()
    turn(timeline)
    assert timeline.tick == 24
    done = timeline.request_step()
    turn(timeline)
    assert (timeline.tick, gate.ended, done.done()) == (30, [30], False)
    gate.answer()
    turn(timeline)
    assert (timeline.tick, done.result(0)) == (36, 36)
    for _ in range(20):
        timeline.request_step()
        turn(timeline)
        gate.answer()
        turn(timeline)
    assert gate.ended == list(range(30, 36 + 20 * STEP + 1, 30))


def test_a_reset_ends_a_step_that_waits(make: Callable[..., Timeline]) -> None:
    gate = FakeGate()
    timeline = make(gate)
    steps = [timeline.request_step() for _ in range(3)]
    turn(timeline)
    timeline.restart()
    with pytest.raises(StepError, match="time was reset"):
        steps[2].result(0)
    gate.answer()
    done = timeline.request_step()
    turn(timeline)
    assert done.result(0) == STEP
