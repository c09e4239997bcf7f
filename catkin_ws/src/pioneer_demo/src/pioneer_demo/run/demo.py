"""Runs a demo: sends a fleet to waypoints, monitors it and writes a report."""

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from pioneer_demo.console.interrupt import Interrupt, Interrupted
from pioneer_demo.console.stopwatch import Stopwatch
from pioneer_demo.error import DemoError, StuckError, VideoError
from pioneer_demo.observer.fleet import faults, stuck_report, time_limit
from pioneer_demo.observer.flip import COURSE
from pioneer_demo.observer.recording import Recording
from pioneer_demo.processes.processes import FleetProcesses
from pioneer_demo.report.report import Outcome, report, reproducible, table, verdict_line
from pioneer_demo.report.view import live_lines
from pioneer_demo.run.fault import FaultRunner
from pioneer_demo.run.fleet_run import FleetRun
from pioneer_demo.scenario.option import DemoConfig
from pioneer_demo.scenario.waypoint import WaypointConfig, fleet_waypoints
from pioneer_harness.error import HarnessError

_DELIVERY = 20.0
_CLOCK_STANDS_STILL = 30.0


class Demo(FleetRun):
    """One demo, from the started processes to the report."""

    _config: DemoConfig

    def __init__(
        self, config: DemoConfig, watch: Stopwatch, interrupt: Interrupt, processes: FleetProcesses
    ) -> None:
        """Takes ``processes`` that are already started; ``run`` ends them."""
        super().__init__(config, watch, interrupt, processes)
        self._recording = Recording() if config.video else None
        self._disturbances: FaultRunner | None = None
        self._sent_at = self._ended_at = math.nan
        self._cpu_at_start = self._cpu_at_end = math.nan

    def run(self) -> int:
        """Runs the demo to its end; returns the exit status.

        Raises:
            Interrupted: after all processes have been ended.
            OSError: the report cannot be written.
        """
        failure: Exception | None = None
        try:
            self.start(COURSE, self._recording, self._choose_waypoints)
            self._drive()
        except (DemoError, HarnessError) as error:
            failure = error
        killed = self._end(in_order=failure is None)
        if isinstance(failure, Interrupted):
            raise failure
        return self._tell(failure, killed)

    def _end(self, in_order: bool) -> tuple[str, ...]:
        """Takes the final measurements and ends everything; returns the command lines of killed processes."""
        self.fleet.ended, self._ended_at = self.fleet.simulator.time, time.monotonic()
        self._cpu_at_end = self.processes.cpu()
        if self._disturbances is not None:
            self._disturbances.close()
        return self.stop(in_order)

    def _drive(self) -> None:
        """Sends the waypoints and monitors the fleet until all are reached or given up.

        Raises:
            StuckError: the fleet is too slow, or simulated time has stopped.
            FaultError: the simulator refuses a fault of the scenario.
        """
        disturbances = self._disturbances = FaultRunner(self._config, self)
        self._send()
        limit = self._limit
        simulator, last, since = self.fleet.simulator, -1.0, time.monotonic()
        course = self.course
        patience = _CLOCK_STANDS_STILL if course is None else self.patience
        while not (
            self.fleet.finished if course is None else course.ended.is_set() and self.fleet.finished
        ):
            self.look(live_lines, "driving")
            if course is None:
                disturbances.advance(simulator.time - self.fleet.began)
            elif course.stands.is_set():
                disturbances.advance(simulator.time - self.fleet.began)
                course.release(self.fleet.began + limit, self.fleet.began + disturbances.next)
            if simulator.time > last:
                last, since = simulator.time, time.monotonic()
            if simulator.time - self.fleet.began > limit and (
                course is None or course.ended.is_set()
            ):
                raise StuckError(
                    "\n".join([stuck_report(self.fleet, limit), *self.seen.waiting_flips()])
                )
            if time.monotonic() - since > patience:
                raise StuckError(
                    f"simulated time has stood still at {last:.1f} s for {patience:.0f} s"
                )

    @property
    def _limit(self) -> float:
        """Simulated time after which the fleet counts as stuck [s]."""
        return self._config.limit or time_limit(self.fleet)

    def _send(self) -> None:
        self._sent_at, self._cpu_at_start = time.monotonic(), self.processes.cpu()
        with self.lock:
            self.fleet.began = self.fleet.simulator.time
            self.fleet.traffic.restart()
        for robot in self.fleet.robots:
            for visit in robot.visits:
                self.seen.send(robot, visit.leg.goal)
        self.watch.note("waypoints sent")
        if self.course is not None:  # tokens carry the waypoints
            assert self._disturbances is not None, "made before"
            self.course.release(
                self.fleet.began + self._limit, self.fleet.began + self._disturbances.next
            )
            return

        def arrived() -> bool:
            return all(
                robot.queue and robot.queue.received >= len(robot.visits)
                for robot in self.fleet.robots
            )

        self.wait_for(
            arrived, "the waypoints' arrival at the robots", "waypoints received", _DELIVERY
        )

    def _choose_waypoints(self) -> None:
        self.seen.read_map()
        self.wait_for(lambda: self.seen.floor is not None, "the map", "map read", _DELIVERY)
        floor = self.seen.floor
        assert floor is not None, "just waited for"
        starts = [robot.pose for robot in self.fleet.robots if robot.pose]
        rng = np.random.default_rng(self._config.seed)
        legs = fleet_waypoints(
            floor, starts, WaypointConfig(count=self._config.waypoints), rng, self._config.goals
        )
        with self.lock:
            for robot, own in zip(self.fleet.robots, legs, strict=True):
                robot.assign(own)

    def _tell(self, failure: Exception | None, killed: tuple[str, ...]) -> int:
        """Prints verdict and table, writes the report; returns the exit status."""
        numbers = report(self.fleet, self._outcome(failure, killed), self._settings())
        folder = self._config.report
        written = [folder / "report.json"]
        result = numbers
        if self.course is not None:
            result, machine = reproducible(numbers)
            written += [*self.course.write(folder), folder / "machine.json"]
            written[-1].write_text(json.dumps(machine, indent=2) + "\n")
        written[0].write_text(json.dumps(result, indent=2) + "\n")
        print(self.display.painted(verdict_line(numbers), numbers["success"]))
        if self.fleet.robots[0].visits:
            print(table(numbers))
        written += self._draw()
        print(f"Written: {', '.join(map(str, written))}; logs in {self._config.log}")
        return 0 if numbers["success"] else 1

    def _draw(self) -> list[Path]:
        """Draws picture and video; returns their paths."""
        floor = self.observer.floor if self.observer else None
        if floor is None:
            return []
        from pioneer_demo.report.picture import draw_fleet

        written = [self._config.report / "fleet.png"]
        reached = sum(robot.reached for robot in self.fleet.robots)
        count = sum(len(robot.visits) for robot in self.fleet.robots)
        name, seed = self._config.map_name, self._config.seed
        title = f"{name}, seed {seed}: {reached} of {count} waypoints reached"
        draw_fleet(floor, self.fleet, title, written[0])
        if self._recording is not None and self._config.video is not None:
            from pioneer_demo.report.video import write_video

            try:
                write_video(floor, self._recording, self.fleet.robots, self._config.video)
                written.append(self._config.video)
            except VideoError as error:
                print(error)
        return written

    def _outcome(self, failure: Exception | None, killed: tuple[str, ...]) -> Outcome:
        problems = [str(failure)] if failure else []
        problems += faults(self.fleet, self._config.success)
        if not failure:
            problems += [f"had to be killed at the end: {line}" for line in killed]
        moving = self.observer.moving_since if self.observer else {}
        for name, moment in moving.items():
            self.watch.note(f"{name} moving", moment)
        everybody = len(moving) == len(self.fleet.robots)
        return Outcome(
            faults=problems,
            milestones=self.watch.milestones,
            seconds_to_moving=self.watch.seconds(max(moving.values())) if everybody else math.nan,
            drive_wall=self._ended_at - self._sent_at,
            drive_cpu=self._cpu_at_end - self._cpu_at_start,
            costs=self.processes.costs(),
        )

    def _settings(self) -> dict[str, Any]:
        config = self._config
        return {
            "robots": config.robots,
            "world": config.world,
            "seed": config.seed,
            "real_time_factor": "lockstep" if config.lockstep else config.real_time_factor,
            "waypoints": config.waypoints,
            "scenario": str(config.scenario or ""),
            "disturbances": [f"{fault.at:g} s: {fault}" for fault in config.faults],
            "ports": str(self.processes.ports),
        }
