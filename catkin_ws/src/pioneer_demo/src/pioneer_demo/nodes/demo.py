"""The course of a demo: wait, send, watch, end, tell."""

import json
import math
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rospy

from pioneer_demo.adapters.interrupt import Interrupt, Interrupted
from pioneer_demo.adapters.map_file import floor_from_file
from pioneer_demo.adapters.processes import FleetProcesses
from pioneer_demo.adapters.stopwatch import Stopwatch
from pioneer_demo.adapters.terminal import Display
from pioneer_demo.core.command import master_uri, robot_name
from pioneer_demo.core.error import DemoError, StartError, StuckError, VideoError
from pioneer_demo.core.fleet import Fleet, faults, stuck_report, time_limit
from pioneer_demo.core.floor import Floor
from pioneer_demo.core.option import DemoConfig
from pioneer_demo.core.recording import Recording
from pioneer_demo.core.report import Outcome, report, table, verdict_line
from pioneer_demo.core.track import RobotTrack
from pioneer_demo.core.view import live_lines
from pioneer_demo.core.waypoint import WaypointConfig, fleet_waypoints
from pioneer_demo.nodes.flip import FlipRequest
from pioneer_demo.nodes.observer import NAME, ObserverNode
from pioneer_harness.error import HarnessError
from pioneer_harness.masters import is_running

_LOOK = 0.05
_SAMPLE = 1.0
_START_UP, _START_UP_PER_ROBOT = 90.0, 20.0
_DELIVERY = 20.0
_CLOCK_STANDS_STILL = 30.0
# roslaunch itself gives a node 15 s before it sends the next signal.
_GRACE, _GRACE_IN_A_HURRY = 30.0, 3.0


class Demo:
    """One demo, from its started processes to its report."""

    def __init__(
        self, config: DemoConfig, map_file: Path, watch: Stopwatch, interrupt: Interrupt, processes: FleetProcesses
    ) -> None:
        """``processes`` have been started; they are ended by ``run``."""
        self._config, self._map_file, self._watch, self._interrupt = config, map_file, watch, interrupt
        self._processes = processes
        self._fleet = Fleet([RobotTrack(robot_name(number)) for number in range(1, config.robots + 1)])
        self._lock = threading.Lock()
        self._display = Display()
        self._floor: Floor | None = None
        self._recording = Recording() if config.video else None
        self._observer: ObserverNode | None = None
        self._sampled = 0.0
        self._sent_at = self._ended_at = math.nan
        self._cpu_at_start = self._cpu_at_end = math.nan

    def run(self) -> int:
        """Runs the demo to its end and returns the exit status.

        Raises:
            Interrupted: after everything has been ended.
            OSError: the report cannot be written.
        """
        failure: Exception | None = None
        try:
            self._start()
            self._drive()
        except (DemoError, HarnessError) as error:
            failure = error
        killed = self._end(in_order=failure is None)
        if isinstance(failure, Interrupted):
            raise failure
        return self._tell(failure, killed)

    def _end(self, in_order: bool) -> tuple[str, ...]:
        """Takes the last figures and ends everything; returns the command lines of what had to be killed."""
        self._fleet.ended, self._ended_at = self._fleet.simulator.time, time.monotonic()
        self._cpu_at_end = self._processes.cpu()
        self._leave_ros()
        self._display.clear()
        if in_order:
            return self._processes.stop(_GRACE, urgent=self._interrupt.has_come)
        return self._processes.stop(_GRACE_IN_A_HURRY, urgent=lambda: False)

    def _start(self) -> None:
        """Waits until every robot can be sent waypoints."""
        self._prepare()
        uri = master_uri(self._processes.ports.hub_gateway_master)
        self._await(lambda: is_running(uri, _LOOK), "Hub_Gateway's ROS master", "hub gateway's master up")
        self._join_ros(uri)
        simulator, robots = self._fleet.simulator, self._fleet.robots
        self._await(lambda: simulator.ready, "the simulator", "simulator ready")
        self._await(lambda: all(robot.pose for robot in robots), "the robots' spawning", "robots spawned")
        self._choose_waypoints()
        self._await(self._flipped, "the hub gateway's flips", "flips accepted")
        self._await(lambda: all(robot.localised for robot in robots), "amcl on each robot", "robots localised")
        self._await(lambda: all(robot.queue for robot in robots), "each robot's waypoint client", "waypoint clients up")
        self._await(lambda: all(map(self._seen.can_be_told, robots)), "the way back to each robot", "robots connected")

    def _prepare(self) -> None:
        """Does what can be done while the processes start."""
        self._floor = floor_from_file(self._map_file)

    def _drive(self) -> None:
        """Sends the waypoints and watches until all are dealt with.

        Raises:
            StuckError: the fleet is too slow, or simulated time does not go on.
        """
        self._send()
        limit = self._config.limit or time_limit(self._fleet)
        simulator, last, since = self._fleet.simulator, -1.0, time.monotonic()
        while not self._fleet.finished:
            self._look(live_lines, "driving")
            if simulator.time > last:
                last, since = simulator.time, time.monotonic()
            if simulator.time - self._fleet.began > limit:
                raise StuckError("\n".join([stuck_report(self._fleet, limit), *self._seen.waiting_flips()]))
            if time.monotonic() - since > _CLOCK_STANDS_STILL:
                raise StuckError(f"simulated time has stood still at {last:.1f} s for {_CLOCK_STANDS_STILL:.0f} s")

    def _send(self) -> None:
        self._sent_at, self._cpu_at_start = time.monotonic(), self._processes.cpu()
        with self._lock:
            self._fleet.began = self._fleet.simulator.time
        for robot in self._fleet.robots:
            for visit in robot.visits:
                self._seen.send(robot, visit.leg.goal)
        self._watch.note("waypoints sent")

        def arrived() -> bool:
            return all(robot.queue and robot.queue.received >= len(robot.visits) for robot in self._fleet.robots)

        self._await(arrived, "the waypoints' arrival at the robots", "waypoints received", _DELIVERY)

    def _choose_waypoints(self) -> None:
        assert self._floor is not None, "only after _prepare"
        starts = [robot.pose for robot in self._fleet.robots if robot.pose]
        rng = np.random.default_rng(self._config.seed)
        legs = fleet_waypoints(self._floor, starts, WaypointConfig(count=self._config.waypoints), rng)
        with self._lock:
            for robot, own in zip(self._fleet.robots, legs, strict=True):
                robot.assign(own)

    def _join_ros(self, uri: str) -> None:
        os.environ.update(ROS_MASTER_URI=uri, ROS_IP="127.0.0.1", ROS_LOG_DIR=str(self._config.report / "log" / "ros"))
        rospy.init_node(NAME, disable_signals=True)
        self._observer = ObserverNode(self._fleet, self._lock, self._recording)
        self._flips = FlipRequest(NAME, self._config.robots)
        self._flips.start()

    def _leave_ros(self) -> None:
        if self._observer is not None:
            self._flips.cancel()
            rospy.signal_shutdown("the demo has ended")

    @property
    def _seen(self) -> ObserverNode:
        assert self._observer is not None, "only after _join_ros"
        return self._observer

    def _flipped(self) -> bool:
        if self._flips.error is not None:
            raise self._flips.error
        return self._flips.done

    def _await(self, condition: Callable[[], object], what: str, milestone: str, timeout: float = 0.0) -> None:
        """Waits for a part, showing that it does; a process's death or Ctrl-C end the wait.

        Raises:
            StartError: not within ``timeout`` [s], by default what is left of the time for starting up.
        """
        began = time.monotonic()
        allowed = timeout or _START_UP + _START_UP_PER_ROBOT * self._config.robots
        while not condition():
            waited = time.monotonic() - began
            if waited > allowed:
                flips = self._observer.waiting_flips() if self._observer else []
                raise StartError("; ".join([f"waited {waited:.0f} s for {what}, in vain", *flips]))
            self._look(lambda fleet: [f"{self._watch.seconds():5.1f} s  waiting for {what} …"], what)
        self._watch.note(milestone)

    def _look(self, lines: Callable[[Fleet], list[str]], phase: str) -> None:
        """One turn of every loop: whatever may end the demo, the display, the accounts, and then a moment's rest."""
        self._interrupt.check()
        self._processes.check()
        with self._lock:
            text = lines(self._fleet)
        self._display.show(text, phase)
        if time.monotonic() - self._sampled > _SAMPLE:
            self._processes.sample()
            self._sampled = time.monotonic()
        changed = self._processes.group.changed
        with changed:
            changed.wait(_LOOK)

    def _tell(self, failure: Exception | None, killed: tuple[str, ...]) -> int:
        """Prints table and verdict, writes the report, and returns the exit status."""
        numbers = report(self._fleet, self._outcome(failure, killed), self._settings())
        folder = self._config.report
        (folder / "report.json").write_text(json.dumps(numbers, indent=2) + "\n")
        if self._fleet.robots[0].visits:
            print(table(numbers), end="\n\n")
        written = [folder / "report.json"]
        if self._floor is not None:
            from pioneer_demo.adapters.picture import draw_fleet

            written.append(folder / "fleet.png")
            draw_fleet(self._floor, self._fleet, self._title(), written[-1])
        print(verdict_line(numbers))
        if self._floor is not None and self._recording is not None and self._config.video is not None:
            from pioneer_demo.adapters.video import write_video

            names = [robot.name for robot in self._fleet.robots]
            try:
                write_video(self._floor, self._recording, names, self._config.video)
                written.append(self._config.video)
            except VideoError as error:
                print(error)
        print(f"Written: {', '.join(map(str, written))}; logs in {folder / 'log'}")
        return 0 if numbers["success"] else 1

    def _outcome(self, failure: Exception | None, killed: tuple[str, ...]) -> Outcome:
        problems = [str(failure)] if failure else []
        problems += faults(self._fleet)
        if not failure:
            problems += [f"had to be killed at the end: {line}" for line in killed]
        moving = self._observer.moving_since if self._observer else {}
        for name, moment in moving.items():
            self._watch.note(f"{name} moving", moment)
        everybody = len(moving) == len(self._fleet.robots)
        return Outcome(
            success=not problems,
            faults=problems,
            milestones=self._watch.milestones,
            seconds_to_moving=self._watch.seconds(max(moving.values())) if everybody else math.nan,
            drive_wall=self._ended_at - self._sent_at,
            drive_cpu=self._cpu_at_end - self._cpu_at_start,
            costs=self._processes.costs(),
        )

    def _settings(self) -> dict[str, Any]:
        config = self._config
        return {
            "robots": config.robots,
            "world": config.world,
            "seed": config.seed,
            "real_time_factor": config.real_time_factor,
            "waypoints": config.waypoints,
            "ports": str(self._processes.ports),
        }

    def _title(self) -> str:
        reached = sum(robot.reached for robot in self._fleet.robots)
        count = sum(len(robot.visits) for robot in self._fleet.robots)
        return f"{self._config.map_name}, seed {self._config.seed}: {reached} of {count} waypoints reached"
