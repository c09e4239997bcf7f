"""Commands reach a robot whatever happens to the clock between their arrival and the next step."""

import random
import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from fake_engine import FakeEngine

from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.ros.mailbox import Mailbox
from pioneer_gazebo.simulation.command import COMMANDS_KEPT, CommandQueue, Moment
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import Timeline
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot

JOIN = 30.0
"""Patience with a thread [s]."""


def no_mesh(mesh: object) -> None:
    raise AssertionError(f"no mesh is in this test: {mesh}")


@pytest.fixture
def make_timeline(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Timeline]:
    """Returns a function that makes a timeline, as fast as possible, whose clock nobody subscribes to."""
    topic = SimpleNamespace(wanted=False, send=lambda frame: None)
    monkeypatch.setattr("pioneer_gazebo.timeline.Topic", lambda *arguments: topic)

    def make() -> Timeline:
        simulation = Simulation(FakeEngine(), no_mesh, Physics())
        return Timeline(simulation, Mailbox(), 0.0, False, 100.0, lambda: None)

    return make


def test_commands_are_taken_when_they_are_due_in_the_order_of_their_arrival() -> None:
    queue = CommandQueue[str]()
    for tick, motion in ((0, "a"), (5, "b"), (6, "c")):
        queue.put(Moment(0, tick), motion)
    assert queue.take(Moment(0, 5)) == ["a", "b"]
    assert queue.take(Moment(0, 5)) == []
    assert queue.take(Moment(0, 12)) == ["c"]


def test_of_too_many_commands_the_newest_are_kept() -> None:
    queue = CommandQueue[int]()
    for number in range(COMMANDS_KEPT + 7):
        queue.put(Moment(0, 0), number)
    assert queue.take(Moment(0, 0)) == list(range(7, COMMANDS_KEPT + 7))


def test_a_command_with_a_time_before_a_reset_blocks_none_after_it(
    make_timeline: Callable[[], Timeline], robot: Robot
) -> None:
    """The thread reads the clock, the simulator resets, and only then the thread queues its command."""
    timeline = make_timeline()
    simulation = timeline.simulation
    driven = simulation.add_robot("r", "r", robot, Pose()).drives[0]
    while timeline.tick < 6000:
        timeline.turn(1.0)
    read = timeline.present()
    timeline.restart()
    driven.command(read, 0.9, 0.0)
    driven.command(timeline.present(), 0.5, 0.0)
    while timeline.tick < 1200:
        timeline.turn(1.0)
    simulation.advance(1200)
    assert simulation.odometry(driven).speed == pytest.approx(0.5, abs=0.01)


def test_a_robot_obeys_after_resets_at_random_moments_while_commands_arrive(
    make_timeline: Callable[[], Timeline], robot: Robot
) -> None:
    timeline = make_timeline()
    simulation = timeline.simulation
    driven = simulation.add_robot("r", "r", robot, Pose()).drives[0]
    ended = threading.Event()
    sent = threading.Event()

    def command() -> None:
        while not ended.is_set():
            driven.command(timeline.present(), 0.5, 0.0)
            sent.set()

    def wait_for_a_command() -> None:
        for _ in range(2):  # the first may have read the clock before
            sent.clear()
            assert sent.wait(JOIN), "no command was sent"

    sender = threading.Thread(target=command)
    sender.start()
    drawn = random.Random(1)
    try:
        for _ in range(100):
            end = drawn.randrange(1, 900)
            while timeline.tick < end:
                timeline.turn(1.0)
            timeline.restart()
            wait_for_a_command()
            while timeline.tick < 300:
                timeline.turn(1.0)
            simulation.advance(timeline.tick)
            assert simulation.odometry(driven).speed == pytest.approx(0.5, abs=0.01)
    finally:
        ended.set()
        sender.join(JOIN)
