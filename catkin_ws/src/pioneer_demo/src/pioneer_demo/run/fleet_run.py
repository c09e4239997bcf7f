"""Runs a fleet: waits for start-up, monitors it, publishes its state for ``./pioneer status``, and ends it."""

import contextlib
import functools
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, NoReturn

import rospy

from pioneer_demo.console.interrupt import Interrupt
from pioneer_demo.console.stopwatch import Stopwatch
from pioneer_demo.console.terminal import Display
from pioneer_demo.error import StartError
from pioneer_demo.observer.fleet import Fleet
from pioneer_demo.observer.flip import STATE, TRAFFIC, FlipRequest
from pioneer_demo.observer.node import ObserverNode
from pioneer_demo.observer.recording import Recording
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.processes.command import (
    RECORDER_COMMAND,
    WATCHERS,
    commands,
    master_uri,
    named_masters,
    on_computer,
    restarted_together,
)
from pioneer_demo.processes.processes import FleetProcesses
from pioneer_demo.processes.relapse import Relapses
from pioneer_demo.report.view import fleet_lines, fleet_status, guide
from pioneer_demo.scenario.option import OBSERVER, FleetConfig
from pioneer_fleet.monitor.hang_watch import HangWatch
from pioneer_fleet.recording.disk import has_room
from pioneer_fleet.registry import Entry, RegistryError
from pioneer_harness.error import ProcessDiedError
from pioneer_harness.masters import is_running
from pioneer_harness.process import Death, last_lines
from pioneer_launch.door import patch_observer

if TYPE_CHECKING:  # imported at run time by a lockstep demo only
    from pioneer_demo.run.course import Course

_LOOK = 0.05
_SAMPLE = 1.0
_START_UP, _START_UP_PER_ROBOT = 90.0, 20.0
_STEPS = 7
# roslaunch waits up to 15 s for a node before it escalates to the next signal.
_GRACE, _GRACE_IN_A_HURRY = 30.0, 3.0


class FleetRun:
    """One fleet on this machine."""

    def __init__(
        self, config: FleetConfig, watch: Stopwatch, interrupt: Interrupt, processes: FleetProcesses
    ) -> None:
        """Takes ``processes`` that are already started; ``stop`` ends them."""
        #: processes: the fleet's processes
        self.processes, self.watch = processes, watch
        every = commands(config, processes.ports)
        processes.group.restartable = frozenset(
            command.name for command in every if restarted_together(config, command.name)
        )
        self._relapses = Relapses()
        self._lost: list[str] = []
        tracks = [RobotTrack(name, name in config.external) for name in config.names]
        self.fleet = Fleet(tracks)  #: its state; guarded by ``lock``
        self.lock = threading.Lock()
        self.display = Display()
        self.observer: ObserverNode | None = (
            None  #: its node on the hub gateway's master; None until that master runs
        )
        #: controls simulated time of a demo in lockstep; None until the observer runs, and without lockstep
        self.course: Course | None = None
        self._flips: FlipRequest | None = None
        self._config, self._interrupt = config, interrupt
        self._entry = _entry()
        self._entry_fails = False
        self._started = time.time()
        self._step, self._sampled = 0, 0.0
        self._hangs = HangWatch(named_masters(processes.ports))
        self._phase = "starting"

    def start(
        self,
        topics: Sequence[str] = STATE,
        recording: Recording | None = None,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> None:
        """Waits until every robot accepts waypoints.

        Args:
            topics: topics of each robot that the observer flips, in addition to /tf.
            recording: receives scans and poses.
            meanwhile: called once all robots are spawned, while navigation is still starting.

        Raises:
            StartError: start-up timed out.
        """
        uri = master_uri(self.processes.ports.hub_gateway_master)
        self._starting(
            lambda: is_running(uri, _LOOK), "Hub_Gateway's ROS master", "hub gateway's master up"
        )
        flipped = self._join_ros(uri, topics, recording)
        simulator, robots = self.fleet.simulator, self.fleet.robots
        self._starting(lambda: simulator.ready, "the simulator", "simulator ready")
        if self.course is not None:
            self.wait_for(
                self.course.stands.is_set,
                "all nodes in lockstep",
                "nodes in lockstep",
                self.patience,
            )
        self._starting(
            lambda: all(robot.pose for robot in robots), "the robots' spawning", "robots spawned"
        )
        meanwhile()
        navigated = [robot for robot in robots if not robot.is_external]
        self._starting(flipped, "the hub gateway's flips", "flips accepted")
        self._starting(
            lambda: all(robot.localised for robot in navigated),
            "amcl on each robot",
            "robots localised",
        )
        self._starting(
            lambda: all(robot.queue for robot in navigated),
            "each robot's waypoint client",
            "clients up",
        )
        self._starting(
            lambda: all(map(self.seen.can_be_sent, navigated)),
            "the way back to each robot",
            "robots connected",
        )

    def stay_up(self) -> NoReturn:
        """Starts the fleet and keeps it running until shutdown is requested; shows its status only on a terminal."""
        try:
            self.start()
            print(guide(self._config, self.processes.ports, self.watch.seconds()), flush=True)
            while True:
                self.look(fleet_lines if self.display.in_place else None, "up")
        finally:
            self.stop(in_order=False)

    @property
    def seen(self) -> ObserverNode:
        """The running observer."""
        assert self.observer is not None, "only after start"
        return self.observer

    def wait_for(
        self, condition: Callable[[], object], what: str, milestone: str, timeout: float
    ) -> None:
        """Waits for a condition and shows ``what`` is awaited; a process's death or Ctrl-C aborts the wait.

        Raises:
            StartError: timed out after ``timeout`` [s].
        """
        began, phase = time.monotonic(), f"waiting for {what}"
        step = f"starting, {self._step} of {_STEPS}: " if self._step else ""
        while not condition():
            waited = time.monotonic() - began
            if waited > timeout:
                flips = self.observer.waiting_flips() if self.observer else []
                raise StartError(
                    "; ".join([f"timed out after {waited:.0f} s waiting for {what}", *flips])
                )
            self.look(lambda fleet: [f"{self.watch.seconds():5.1f} s  {step}{phase} …"], phase)
        self.watch.note(milestone)

    def look(self, lines: Callable[[Fleet], list[str]] | None, phase: str) -> None:
        """One iteration of every main loop: checks for shutdown, shows and publishes the state, then waits briefly."""
        self._interrupt.check()
        for line in self.processes.check(starting=bool(self._step)):
            self.display.say(line)
        self._restart_commands()
        for line in self._hangs.news():
            self.display.say(line)
        if lines:
            self.display.show(functools.partial(self._text, lines), phase)
        if time.monotonic() - self._sampled > _SAMPLE or phase != self._phase:
            self._phase = phase
            self._publish()
        changed = self.processes.group.changed
        with changed:
            changed.wait(_LOOK)

    def _restart_commands(self) -> None:
        """Starts commands that have ended again, unless they keep dying, each with those of its computer.

        Raises:
            ProcessDiedError: a robot's computer or the hub ends while the fleet starts, or keeps dying.
        """
        lost = self.processes.lost_computers
        self.processes.lost_computers = {}
        for death in self.processes.group.take_restartable_deaths():
            cause = self.processes.cause(death)
            first = (cause or _last_line(death)).partition("\n")[0]
            lost[death.name] = f"{death.headline}: {first}" if first else death.headline
            if death.name not in WATCHERS and self._step:
                raise ProcessDiedError(f"{death}\n{cause}" if cause else str(death))
        restarted = set[str]()
        for name, reason in lost.items():
            together = restarted_together(self._config, name)
            if name in restarted:
                continue
            restarted.update(together)
            if name == RECORDER_COMMAND and not self._has_room_to_record():
                self._lose(f"the recorder has ended and is not started again: {reason}")
                continue
            if self._relapses.died(together[0], name, reason, time.monotonic()):
                text = f"{name} keeps dying and is not started again: {reason}"
                if name not in WATCHERS:
                    raise ProcessDiedError(text)
                self._lose(text)
            else:
                self._restart(name, together, reason)

    def _lose(self, text: str) -> None:
        """Reports that something has ended for good that the robots need not."""
        self._lost.append(text)
        self.display.say(text)

    def _has_room_to_record(self) -> bool:
        return self._config.record is None or has_room(self._config.record.absolute().parent)

    def _restart(self, name: str, together: Sequence[str], reason: str) -> None:
        robots = [robot for robot in self._config.names if name in on_computer(self._config, robot)]
        if not robots:
            self.display.say(f"{reason} and is started again")
        for robot in robots:
            self.display.say(
                f"{reason}; {robot}'s computer is started again and resumes its waypoints"
            )
            with self.lock:
                monitor = self.fleet.robots[self._config.names.index(robot)].monitor
                monitor.queue = None
                monitor.said.clear()
        if name not in WATCHERS:
            self.processes.kill_computer(together)
        self.processes.restart(together)

    def _faults(self) -> list[str]:
        return [*self.processes.faults(), *self._lost, *self._hangs.faults()]

    def stop(self, in_order: bool) -> tuple[str, ...]:
        """Ends everything, with a short grace period unless ``in_order``; returns command lines of killed processes."""
        self._hangs.close()
        if self._flips is not None:
            self._flips.cancel()
        if self.observer is not None:
            rospy.signal_shutdown("the fleet ends")
        self.display.clear()
        try:
            if in_order:
                return self.processes.stop(_GRACE, urgent=self._interrupt.is_set)
            return self.processes.stop(_GRACE_IN_A_HURRY, urgent=lambda: False)
        finally:
            if self._entry is not None:
                self._entry.close()

    def _starting(self, condition: Callable[[], object], what: str, milestone: str) -> None:
        self._step += 1
        self.wait_for(condition, what, milestone, self.patience)
        if self._step == _STEPS:
            self._step = 0

    @property
    def patience(self) -> float:
        """Time-out for each start-up step [s]."""
        return _START_UP + _START_UP_PER_ROBOT * self._config.robots

    def _join_ros(
        self, uri: str, topics: Sequence[str], recording: Recording | None
    ) -> Callable[[], bool]:
        """Starts the observer; returns a function that tells whether its flips are accepted."""
        os.environ.update(
            ROS_MASTER_URI=uri,
            ROS_IP="127.0.0.1",
            ROS_LOG_DIR=str(self._config.log.resolve() / "ros"),
        )
        patch_observer()
        self._register_observer()
        if self._config.rings:
            from pioneer_demo.run.course import Course

            self.course = Course(OBSERVER, self.fleet, self.lock)
        self.observer = ObserverNode(self.fleet, self.lock, recording)
        if self.course is not None:
            self.course.start()  # tokens replace the flips
            return lambda: True
        flipped = (*topics, *(TRAFFIC if self._config.traffic else ()))
        self._flips = FlipRequest(OBSERVER, self._config.names, flipped)
        self._flips.start()
        return self._flips.accepted

    def _register_observer(self) -> None:
        """Initialises rospy, which waits for the master without limit: in a thread, so that this wait has one.

        Raises:
            StartError: the master does not answer in time.
            ProcessDiedError: it has died.
        """
        registered = Future[None]()

        def register() -> None:
            try:
                rospy.init_node(OBSERVER, disable_signals=True)
            except Exception as error:  # noqa: BLE001 - raised again by the thread that waits
                registered.set_exception(error)
            else:
                registered.set_result(None)

        threading.Thread(target=register, name="registration", daemon=True).start()
        began = time.monotonic()
        while not registered.done():
            if time.monotonic() - began > self.patience:
                raise StartError(
                    f"timed out after {self.patience:.0f} s waiting for Hub_Gateway's ROS master to register "
                    "the observer"
                )
            self.look(None, self._phase)
        registered.result()

    def _text(self, lines: Callable[[Fleet], list[str]]) -> list[str]:
        with self.lock:
            return [*lines(self.fleet), *self._faults()]

    def _publish(self) -> None:
        self.processes.sample()
        with self.lock:
            faults = self._faults()
            ports = self.processes.ports
            status = fleet_status(
                self.fleet, self._config, ports, self._phase, faults, time.monotonic()
            )
        if self._entry is not None:
            self._write_entry(self._entry, {**status, "started": self._started})
        self._sampled = time.monotonic()

    def _write_entry(self, entry: Entry, status: dict[str, Any]) -> None:
        """Publishes the status for other commands; on a full disk they see an old one, and the fleet keeps running."""
        try:
            entry.write(status)
        except OSError as error:
            is_new, self._entry_fails = not self._entry_fails, True
            if is_new:
                # The output may be on the same full disk.
                with contextlib.suppress(OSError):
                    print(
                        f"./pioneer status sees an old state of this fleet: {error}",
                        file=sys.stderr,
                    )
        else:
            self._entry_fails = False


def _last_line(death: Death) -> str:
    """Returns the last line that a command has printed, if it has ended by itself with an error."""
    if death.log is None or death.status <= 0:
        return ""
    return last_lines(death.log, 1).strip()


def _entry() -> Entry | None:
    """Returns this fleet's entry in the registry; None, with a warning, if there is no safe place for it."""
    try:
        return Entry()
    except RegistryError as error:
        print(f"./pioneer status will not find this fleet: {error}", file=sys.stderr)
        return None
