"""Advances simulated time and runs the tasks that are due."""

from collections.abc import Callable

from rosgraph_msgs.msg import Clock

from pioneer_gazebo import conversions
from pioneer_gazebo.core.schedule import TICK_RATE, Schedule, nanoseconds
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.lockstep import LockstepGate
from pioneer_gazebo.nodes.mailbox import Mailbox
from pioneer_gazebo.nodes.pace import Pacer
from pioneer_gazebo.nodes.topic import Topic

LONGEST = TICK_RATE // 10
"""Maximum interval between world updates [ticks of simulated time], even if nothing reads the state."""

GATE_PATIENCE = 0.1
"""Interval at which the current lockstep period is checked [s of wall time]."""


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
        self._clock = Topic("/clock", Clock, self.schedule.review)
        self.schedule.add("/clock", clock_rate, self._publish_clock, lambda: self._clock.wanted, False)

    def present(self) -> int:
        """Returns the current tick, or the target of the current step if the simulation lags. Thread-safe."""
        if self._gate is not None:
            return self.tick
        reached = self.pacer.reached() * TICK_RATE
        return 0 if self.paused else int(min(reached, self._target))

    def serve(self) -> None:
        """Does the work in the mailbox, on the world's current state."""
        if self.mailbox.pending:
            if not self.paused and self._gate is None:
                self.tick = max(self.tick, min(self.present(), self._target - 1))
            self.simulation.advance(self.tick)
            self.mailbox.serve()

    def turn(self, patience: float) -> None:
        """Waits for the next tick with due tasks, at most ``patience`` [s] or until work arrives; runs it."""
        if self.paused:
            self.mailbox.wait(patience)
            return
        if self._gate is not None and self._gate.holds(self.tick):
            self.mailbox.wait(min(patience, GATE_PATIENCE))
            return
        tick = self._target = min(self.schedule.next_after(self.tick), self.tick + LONGEST)
        if self._gate is not None:
            tick = self._target = min(tick, self._gate.until)
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
        self._clock.send(conversions.clock_frame(nanoseconds(tick)))

    def pause(self, paused: bool) -> None:
        """Pauses or resumes simulated time."""
        self.paused = paused
        self.pacer.restart()
        self.publish_now()

    def set_factor(self, factor: float) -> None:
        """Sets the real-time factor; 0: as fast as possible."""
        self.pacer.factor = factor
        self.pacer.restart()

    def step(self) -> None:
        """Advances by one physics step; only while paused."""
        end = self.tick + round(self.simulation.physics.step * TICK_RATE)
        while (tick := self.schedule.next_after(self.tick)) <= end:
            self._run_to(tick)
        self.simulation.advance(end)
        self.tick = end

    def restart(self) -> None:
        """Resets time to 0."""
        self.tick = self._target = 0
        self.pacer.restart()
        if self._gate is not None:
            self._gate.restart()
