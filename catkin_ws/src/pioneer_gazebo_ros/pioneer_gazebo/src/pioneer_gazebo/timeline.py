"""Paces simulated time by wall time, advances it and runs due tasks, and limits the time spent on rendering."""

import math
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from rosgraph_msgs.msg import Clock

from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.lockstep.gate import LockstepGate
from pioneer_gazebo.ros import messages
from pioneer_gazebo.ros.mailbox import Mailbox
from pioneer_gazebo.ros.topic import Topic
from pioneer_gazebo.simulation.command import Moment
from pioneer_gazebo.simulation.schedule import TICK_RATE, Schedule, nanoseconds
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_node.nodes.standing_warning import StandingWarning

MOST_BEHIND = 0.2
"""Maximum lag [s]; a simulator that is further behind does not catch up but continues from there."""


class Pacer:
    """Computes when simulated times are due, from an anchor at which both clocks were read."""

    def __init__(self, factor: float) -> None:
        """Takes the real-time factor; 0 for as fast as possible."""
        self.factor = factor
        self._anchor: tuple[float, float] | None = None
        self._excused = 0.0
        self._measured = (0.0, time.monotonic())

    def restart(self) -> None:
        """Sets a new anchor at the next time: after a pause, or after a change of the factor."""
        self._anchor = None

    def wait_for(self, simulated: float) -> float:
        """Returns how long [s] to wait until ``simulated`` [s] is due; 0 or less if it is due."""
        if self.factor <= 0:
            return 0.0
        now = time.monotonic()
        if self._anchor is None:
            self._anchor = simulated, now
        wait = self._anchor[1] + (simulated - self._anchor[0]) / self.factor - now
        if wait >= 0.0:
            self._excused = 0.0
        elif wait < -MOST_BEHIND - self._excused:
            self._anchor = simulated, now
            return 0.0
        return wait

    def excuse(self, seconds: float) -> None:
        """Increases the permitted lag by ``seconds`` until the simulator has caught up."""
        self._excused += seconds

    def reached(self) -> float:
        """Returns the simulated time [s] due now; infinity if time is not paced. Thread-safe."""
        anchor = self._anchor
        if self.factor <= 0 or anchor is None:
            return math.inf
        return anchor[0] + (time.monotonic() - anchor[1]) * self.factor

    def measured(self, simulated: float) -> float:
        """Returns the real-time factor since the last call."""
        now = time.monotonic()
        (then, wall), self._measured = self._measured, (simulated, now)
        return max(0.0, simulated - then) / max(1e-9, now - wall)


SHARE = 0.4
"""Maximum share of wall time for rendering."""

SAVED = 0.5
"""Maximum wall time [s] that can be saved up for rendering."""

REPORT_PERIOD = 30.0
"""Minimum interval between reports about dropped images [s of wall time]."""


class Budget:
    """The wall time budget for images; unlimited if simulated time runs as fast as possible."""

    def __init__(self, pacer: Pacer) -> None:
        """Takes the pacer of simulated time, which may catch up the time spent on rendering."""
        self._pacer = pacer
        self._left = SAVED
        self._then = self._left_out = time.monotonic()
        self._late = StandingWarning("pictures are complete again", REPORT_PERIOD)

    def draw(self, name: str, picture: Callable[[], None]) -> bool:
        """Renders an image if the budget allows it; returns whether it did."""
        now = time.monotonic()
        self._left = min(SAVED, self._left + SHARE * (now - self._then))
        self._then = now
        if self._pacer.factor > 0 and self._left <= 0.0:
            self._left_out = now
            self._late.warn(
                f"{name}: rendering exceeds {SHARE:.0%} of the time; dropping images so that physics keeps its pace;"
                " reduce the camera's size or rate"
            )
            return False
        if now - self._left_out > REPORT_PERIOD:
            self._late.end()
        picture()
        took = time.monotonic() - now
        self._left -= took
        self._pacer.excuse(took)
        return True


LONGEST = TICK_RATE // 10
"""Maximum interval between world updates [ticks of simulated time], even if nothing reads the state."""

GATE_PATIENCE = 0.1
"""Interval at which the current lockstep period is checked [s of wall time]."""


class StepError(SimulatorError):
    """A single step is not possible, or was not done."""


class Timeline:
    """Advances simulated time at the requested pace, runs due tasks, and publishes ``/clock``.

    Used from the simulation's thread, except for `present`.
    """

    def __init__(
        self, simulation: Simulation, mailbox: Mailbox, factor: float, paused: bool, clock_rate: float,
        after_tick: Callable[[], None], gate: LockstepGate | None = None,
    ) -> None:  # fmt: skip
        """Starts at tick 0; ``after_tick`` is called after all tasks of a tick, and ``gate`` holds time.

        Raises:
            RateError: the clock rate does not divide the tick rate.
        """
        #: simulation: the simulation
        #: paused: whether simulated time stands still
        #: mailbox: work from other threads, done between two ticks
        self.mailbox, self.simulation, self.paused = mailbox, simulation, paused
        self.pacer = Pacer(factor)  #: paces simulated time by wall time
        self.schedule = Schedule()  #: tasks by tick
        if gate is not None:
            gate.changed = self.schedule.review
        #: tick: the current tick
        self.tick = self._target = 0
        self._after_tick = after_tick
        self._gate = gate
        #: requested single steps: the tick at which each ends, and the future that receives it
        self._steps: deque[tuple[int, Future[int]]] = deque()
        self._clock = Topic("/clock", Clock, self.schedule.review)
        self.schedule.add(
            "/clock", clock_rate, self._publish_clock, lambda: self._clock.wanted, False
        )

    def present(self) -> Moment:
        """Returns the current time, or the target of the current step if the simulation lags. Thread-safe.

        The epoch is read first: if time restarts meanwhile, the tick may be of either time, but the epoch is past.
        """
        epoch = self.simulation.epoch
        return Moment(epoch, self._present_tick())

    def _present_tick(self) -> int:
        if self._gate is not None:
            return self.tick
        reached = self.pacer.reached() * TICK_RATE
        return 0 if self.paused else int(min(reached, self._target))

    def serve(self) -> None:
        """Does the work in the mailbox, on the world's current state."""
        if self.mailbox.pending:
            if not self.paused and self._gate is None:
                self.tick = max(self.tick, min(self._present_tick(), self._target - 1))
            self.simulation.advance(self.tick)
            self.mailbox.serve()

    def turn(self, patience: float) -> None:
        """Waits for the next tick with due tasks, at most ``patience`` [s] or until work arrives; runs it."""
        if self.paused and not self._steps:
            self.mailbox.wait(patience)
            return
        if self._gate is not None and self._gate.holds(self.tick):
            self.mailbox.wait(min(patience, GATE_PATIENCE))
            return
        tick = min(self.schedule.next_after(self.tick), self.tick + LONGEST)
        if self._gate is not None:
            tick = min(tick, self._gate.until)
        if self._steps:
            self._step_to(min(tick, self._steps[0][0]))
            return
        self._target = tick
        wait = self.pacer.wait_for(tick / TICK_RATE)
        if wait > 0 and (self.mailbox.wait(min(wait, patience)) or wait > patience):
            return
        self._run_to(tick)

    def _run_to(self, tick: int) -> None:
        """Advances time to a tick and runs the tasks due; advances the world only if one of them needs its state."""
        due = self.schedule.due(tick)
        if tick - self.simulation.tick >= LONGEST or any(task.needs_state for task in due):
            self.simulation.advance(tick)
        self.tick = tick
        for task in due:
            task.action(tick)
        self._after_tick()
        if self._gate is not None:
            self._gate.reached(tick)

    def publish_now(self) -> None:
        """Publishes the time, for subscribers that connected while it stood still."""
        self._publish_clock(self.tick)

    def _publish_clock(self, tick: int) -> None:
        self._clock.send(messages.clock_frame(nanoseconds(tick)))

    def pause(self, paused: bool) -> None:
        """Pauses or resumes simulated time."""
        self.paused = paused
        self.pacer.restart()
        self.publish_now()

    def set_factor(self, factor: float) -> None:
        """Sets the real-time factor; 0: as fast as possible."""
        self.pacer.factor = factor
        self.pacer.restart()

    def request_step(self) -> "Future[int]":
        """Requests one physics step, which `turn` runs; returns the future that receives the tick at its end.

        In lockstep a step waits for the nodes, as time does that runs by itself.

        Raises:
            StepError: time runs by itself.
        """
        if not self.paused:
            raise StepError("step works while physics is paused (pause_physics)")
        begin = self._steps[-1][0] if self._steps else self.tick
        done = Future[int]()
        self._steps.append((begin + round(self.simulation.physics.step * TICK_RATE), done))
        return done

    def cancel_steps(self, reason: str) -> None:
        """Drops the requested steps that are not done; their futures raise StepError."""
        while self._steps:
            self._steps.popleft()[1].set_exception(StepError(reason))

    def _step_to(self, tick: int) -> None:
        """Runs to a tick of the first requested step."""
        self._target = tick
        if tick > self.tick:
            self._run_to(tick)
        if self.tick >= self._steps[0][0]:
            self.simulation.advance(self.tick)
            self._steps.popleft()[1].set_result(self.tick)

    def restart(self) -> None:
        """Resets time to 0, and the simulation with it."""
        self.cancel_steps("time was reset")
        self.tick = self._target = 0
        self.pacer.restart()
        if self._gate is not None:
            self._gate.restart()
        self.simulation.reset()
