"""Random sequences of what the services of a simulator do: no task is left out, and nothing jumps.

Environment: ``PIONEER_SEQUENCES_MINUTES`` for long runs, ``PIONEER_SEQUENCES_FIRST`` for the first seed.
"""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import box_model, floor

from pioneer_gazebo.error import ModelError
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import STILL, Physics, Velocity
from pioneer_gazebo.ros.mailbox import Mailbox
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import Timeline
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import World
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot

MINUTES = float(os.environ.get("PIONEER_SEQUENCES_MINUTES", "0.05"))
FIRST = int(os.environ.get("PIONEER_SEQUENCES_FIRST", "1"))
RATES = (600 / 7, 50.0, 100.0, 300.0)
"""Rates of the recorders [Hz]."""
PERIOD = 30
"""Of lockstep [ticks]."""
MARGIN = 0.004
"""Distance that a body may move beyond its speeds between two records, as contacts push it [m]."""
CELL = 2.0
"""Distance between the places of models [m]: no two touch when they are placed."""
ACTIONS = 150
"""Actions of a sequence."""


def is_near(one: Pose, other: Pose) -> bool:
    """Returns whether two poses are equal except for rounding."""
    values = (*one.position, *one.rotation)
    return values == pytest.approx((*other.position, *other.rotation), abs=1e-9)


class Gate:
    """Lockstep whose nodes answer when `answer` is called."""

    def __init__(self) -> None:
        self.until = PERIOD
        self.ended: list[int] = []
        self._waits = False

    def holds(self, tick: int) -> bool:
        assert tick <= self.until, "time has left the period"
        return self._waits

    def reached(self, tick: int) -> None:
        assert tick <= self.until, "time has left the period"
        if tick == self.until:
            self.ended.append(tick)
            self.until += PERIOD
            self._waits = True

    def answer(self) -> None:
        self._waits = False

    def restart(self) -> None:
        self.until = PERIOD
        self.ended.clear()


@dataclass
class Record:
    """What a recorder saw of an entity."""

    tick: int
    pose: Pose
    speed: float
    placed: int  #: how often the entity had been placed


class Recorder:
    """Checks at each tick of a rate that none was left out and that no entity has jumped."""

    def __init__(self, simulation: Simulation, period: int, placed: dict[Entity, int]) -> None:
        self._simulation, self._period, self._placed = simulation, period, placed
        self._last: dict[Entity, Record] = {}
        self._due = 0

    def restart(self) -> None:
        self._last.clear()
        self._due = 0

    def take(self, tick: int) -> None:
        assert self._due in (0, tick), f"the task of tick {self._due} was left out"
        self._due = tick + self._period
        records = {entity: self._record(entity, tick) for entity in self._simulation.entities()}
        for entity, now in records.items():
            before = self._last.get(entity)
            if before is None or before.placed != now.placed:
                continue
            seconds = (now.tick - before.tick) / TICK_RATE
            moved = math.dist(now.pose.position, before.pose.position)
            # A step may change the speed once, from the one before to the one after.
            most = max(now.speed, before.speed) + 9.81 * seconds
            assert moved <= most * (seconds + self._simulation.physics.step) + MARGIN, (
                f"{entity.name} jumped by {moved:.3f} m at tick {tick}"
            )
        self._last = records

    def _record(self, entity: Entity, tick: int) -> Record:
        velocity = self._simulation.velocity(entity)
        pose = self._simulation.pose(entity)
        assert all(map(math.isfinite, (*pose.position, *pose.rotation)))
        return Record(tick, pose, math.hypot(*velocity.linear), self._placed.get(entity, 0))


class Sequence:
    """A simulator without ROS, and random actions on it."""

    def __init__(self, timeline: Timeline, gate: Gate | None, robot: Robot, seed: int) -> None:
        self._timeline, self._simulation, self._gate = timeline, timeline.simulation, gate
        self._robot, self._rng = robot, np.random.default_rng(seed)
        self._placed: dict[Entity, int] = {}
        self._count = 0
        self._recorders = []
        for rate in RATES:
            recorder = Recorder(self._simulation, round(TICK_RATE / rate), self._placed)
            timeline.schedule.add("recorder", rate, recorder.take)
            self._recorders.append(recorder)
        for _ in range(3):
            self.spawn()

    def act(self) -> None:
        """Does a random action."""
        actions = (
            self.run, self.run, self.run, self.pause, self.step, self.step, self.place, self.place,
            self.spawn, self.delete, self.command, self.reset_world, self.reset_simulation,
            self.change_step,
        )  # fmt: skip
        actions[self._rng.integers(len(actions))]()

    def run(self) -> None:
        """Lets time run for a random number of ticks with tasks."""
        self._timeline.pause(False)
        for _ in range(self._rng.integers(1, 200)):
            self._turn()

    def pause(self) -> None:
        self._timeline.pause(True)
        before = self._timeline.tick
        self._turn()
        assert self._timeline.tick == before

    def step(self) -> None:
        """Requests some steps at once and waits for them."""
        self._timeline.pause(True)
        begin = self._timeline.tick
        steps = [self._timeline.request_step() for _ in range(self._rng.integers(1, 8))]
        for _ in range(1000):
            if steps[-1].done():
                break
            self._turn()
        length = round(self._simulation.physics.step * TICK_RATE)
        ends = [step.result(0) for step in steps]
        assert ends == [begin + number * length for number in range(1, len(steps) + 1)]

    def spawn(self) -> None:
        """Spawns a robot or a box at a free place."""
        place = self._free_place()
        if place is None or len(list(self._simulation.entities())) > 8:
            return
        self._count += 1
        x, y = place
        yaw = self._rng.uniform(-math.pi, math.pi)
        name = f"m{self._count}"
        if self._rng.random() < 0.5:
            pose = Pose.from_rpy(x, y, 0.0, 0.0, 0.0, yaw)
            self._simulation.add_robot(name, name, self._robot, pose)
        else:
            pose = Pose.from_rpy(x, y, 0.2 + self._rng.random(), 0.0, 0.0, yaw)
            self._simulation.add_model(box_model(name, pose, (0.4, 0.4, 0.4), static=False))

    def delete(self) -> None:
        entity = self._any()
        if entity is not None:
            self._simulation.remove(entity.name)
            with pytest.raises(ModelError):
                self._simulation.entity(entity.name)

    def place(self) -> None:
        """Sets pose and velocity of a model."""
        entity, place = self._any(), self._free_place()
        if entity is None or place is None:
            return
        x, y = place
        vx, vy, spin = self._rng.uniform(-1.0, 1.0, 3)
        height = 0.02 if entity.robot is not None else 0.25
        pose = Pose.from_rpy(x, y, height, 0.0, 0.0, self._rng.uniform(-3.0, 3.0))
        velocity = STILL if self._rng.random() < 0.5 else Velocity((vx, vy, 0.0), (0.0, 0.0, spin))
        self._simulation.place(entity.name, pose, velocity)
        self._placed[entity] = self._placed.get(entity, 0) + 1
        assert is_near(self._simulation.pose(entity), pose)

    def command(self) -> None:
        entity = self._any()
        if entity is not None and entity.drives:
            speed, turn = self._rng.uniform(-0.7, 0.7, 2)
            entity.drives[0].command(self._timeline.present(), speed, turn)

    def reset_world(self) -> None:
        self._simulation.reset_poses()
        for entity in self._simulation.entities():
            self._placed[entity] = self._placed.get(entity, 0) + 1

    def reset_simulation(self) -> None:
        self._timeline.restart()
        for recorder in self._recorders:
            recorder.restart()
        if self._gate is not None:
            self._gate.answer()
        assert self._timeline.tick == self._simulation.tick == 0

    def change_step(self) -> None:
        """Sets another physics step, which moves nothing."""
        before = [self._simulation.pose(entity) for entity in self._simulation.entities()]
        step = self._rng.choice([1 / 600, 0.01, 0.02, 0.02, 0.05])
        self._simulation.configure(Physics(float(step)))
        after = [self._simulation.pose(entity) for entity in self._simulation.entities()]
        assert all(map(is_near, after, before))

    def _turn(self) -> None:
        self._timeline.turn(0.0)
        self._timeline.serve()
        if self._gate is not None:
            assert self._gate.ended == list(range(PERIOD, self._timeline.tick + 1, PERIOD))
            # The nodes answer some turns later.
            if self._rng.random() < 0.3:
                self._gate.answer()

    def _any(self) -> Entity | None:
        entities = list(self._simulation.entities())
        return entities[self._rng.integers(len(entities))] if entities else None

    def _free_place(self) -> tuple[float, float] | None:
        """Returns a place without anything near, also where models began; None if none was found."""
        taken = [self._simulation.pose(one).position for one in self._simulation.entities()]
        taken += [one.initial.position for one in self._simulation.entities()]
        for _ in range(30):
            x, y = self._rng.uniform(-18.0, 18.0, 2)
            if all(math.dist((x, y), other[:2]) > CELL for other in taken):
                return float(x), float(y)
        return None


@pytest.fixture
def timeline_topic(monkeypatch: pytest.MonkeyPatch) -> None:
    topic = SimpleNamespace(wanted=False, send=lambda frame: None)
    monkeypatch.setattr("pioneer_gazebo.timeline.Topic", lambda *arguments: topic)


def run_sequence(robot: Robot, seed: int, lockstep: bool) -> int:
    """Runs a sequence and frees its world; returns the ticks of simulated time that it took."""
    gate = Gate() if lockstep else None
    engine = BulletEngine()
    try:
        simulation = Simulation(engine, triangles_of_mesh, Physics(), seed)
        simulation.load(World("test", (floor(),)))
        ticks = [0]

        def count() -> None:
            ticks[0] += 1

        timeline = Timeline(simulation, Mailbox(), 0.0, True, 100.0, count, gate)  # type: ignore[arg-type]
        sequence = Sequence(timeline, gate, robot, seed)
        for _ in range(ACTIONS):
            sequence.act()
        return ticks[0]
    finally:
        engine.close()


@pytest.mark.parametrize("lockstep", [False, True])
def test_random_sequences_leave_no_task_out_and_let_nothing_jump(
    timeline_topic: None, robot: Robot, lockstep: bool, record_property: Callable[..., None]
) -> None:
    end = time.monotonic() + MINUTES * 60.0
    seed, ticks = FIRST, 0
    while seed == FIRST or time.monotonic() < end:
        try:
            ticks += run_sequence(robot, seed, lockstep)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {error}") from error
        seed += 1
    record_property("sequences", seed - FIRST)
    record_property("turns", ticks)
