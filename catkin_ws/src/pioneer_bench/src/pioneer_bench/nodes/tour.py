"""One tour: a master, the simulator, one robot with its navigation, and the demo's observer, which sends the waypoints.

Master and observer live in this process; roslaunch starts the simulator and the nodes.
"""

import dataclasses
import json
import math
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import rospkg
import rospy

from nav_bundle.base import pose as navigation
from nav_bundle.maps import map_quality
from nav_bundle.maps.conversions import GridMessage, grid_from_message
from nav_bundle.maps.map_file import read_map
from pioneer_bench.core.tour import CONDITIONS, Condition, Tour
from pioneer_demo.observer.fleet import Fleet, stuck_report, time_limit
from pioneer_demo.observer.node import ObserverNode
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.processes.kind import COMMAND, kind
from pioneer_demo.scenario.floor import Floor, floor_from_cells
from pioneer_demo.scenario.waypoint import WaypointConfig, fleet_waypoints
from pioneer_fleet.geometry import Pose
from pioneer_gazebo.fleet.pose_file import poses_of_world, read_poses
from pioneer_harness.accounting import Account
from pioneer_harness.error import HarnessError
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup, last_lines
from pioneer_harness.wait import wait_until

ROBOT = "pioneer1"
PATIENCE = 90.0
"""Time-out for start-up [wall s]."""
SAMPLE = 0.5
"""Period of sampling the processes [wall s]."""
STANDSTILL = 30.0
"""Wall time without progress of simulated time after which the simulator counts as dead [s]."""
SHORTEST, LONGEST = 8.0, 18.0
"""Path length between waypoints [m]: thirteen metres on average, as in the C++ stack's tours."""


@dataclasses.dataclass(frozen=True, slots=True)
class TourConfig:
    """Arguments of one tour, under the names of the command's options."""

    condition: str
    seed: int
    waypoints: int
    world: str
    real_time_factor: float


class MappedTrack(RobotTrack):
    """Track of a robot that maps: the origin of its map is the robot's start pose."""

    def __init__(self, name: str, start: Pose) -> None:
        super().__init__(name)
        self._start_pose = start

    def add_correction(self, pose: Pose) -> None:
        """Adds a transform map → odom, whose map has its origin at the start pose."""
        super().add_correction(self._start_pose.compose(pose))


class TourNode:
    """Sends one robot its waypoints and records what it does.

    Subscribes: as ``ObserverNode``; with mapping, also the robot's ``map``.
    Threads: rospy's callbacks write into the fleet; ``run`` reads it.
    On error: raises if start-up takes too long; reports a robot that gets stuck as the tour's fault.
    """

    def __init__(self, config: TourConfig, start: Pose, group: ProcessGroup) -> None:
        self._config, self._start, self._group = config, start, group
        self._condition: Condition = CONDITIONS[config.condition]
        self._robot = MappedTrack(ROBOT, start) if self._condition.mapping else RobotTrack(ROBOT)
        self._fleet, self._lock = Fleet([self._robot]), threading.Lock()
        self._account = Account(kind, short=COMMAND)
        self._observer = ObserverNode(self._fleet, self._lock)
        self._map: Any = None
        if self._condition.mapping:
            rospy.Subscriber(f"/{ROBOT}/map", GridMessage, self._on_map, queue_size=1)

    def _on_map(self, message: Any) -> None:
        self._map = message

    def run(self, map_file: Path) -> Tour:
        """Waits for the robot, sends it round, and returns the results.

        Raises:
            HarnessError: a process has died, or the robot did not start in time.
        """
        wait_until(self._ready, "the robot, localised, and its waypoint client", PATIENCE)
        grid = read_map(map_file)
        floor = floor_from_cells(grid.cells, grid.resolution, grid.origin.x, grid.origin.y)
        assert self._robot.pose is not None
        choice = WaypointConfig(count=self._config.waypoints, shortest=SHORTEST, longest=LONGEST)
        rng = np.random.default_rng(self._config.seed)
        legs = fleet_waypoints(floor, [self._robot.pose], choice, rng)[0]
        with self._lock:
            self._robot.assign(legs)
            self._fleet.began = self._fleet.simulator.time
        wall, cpu = time.monotonic(), self._cpu()
        for leg in legs:
            self._observer.send(self._robot, self._in_its_map(leg.goal))
        fault = self._follow(time_limit(self._fleet))
        with self._lock:
            return self._tour(floor, map_file, time.monotonic() - wall, cpu, fault)

    def _in_its_map(self, goal: Pose) -> Pose:
        """Returns a goal in the robot's map frame: with mapping, its origin is the start pose."""
        if not self._condition.mapping:
            return goal
        own = _planar(self._start).inverse().compose(_planar(goal))
        return Pose(own.x, own.y, own.yaw)

    def _ready(self) -> bool:
        self._group.check()
        robot = self._robot
        known = robot.pose is not None and robot.localised and robot.queue is not None
        return known and self._observer.can_be_sent(robot)

    def _follow(self, limit: float) -> str:
        """Waits until all waypoints are reached or given up; returns what went wrong, or an empty string."""
        told, last, since = 0, -1.0, time.monotonic()
        while not self._fleet.finished:
            self._group.check()
            self._group.sample(self._account)
            now = self._fleet.simulator.time
            if now > last:
                last, since = now, time.monotonic()
            if time.monotonic() - since > STANDSTILL:
                return f"simulated time has stood still at {last:.1f} s"
            if now - self._fleet.began > limit:
                return stuck_report(self._fleet, limit).replace("\n", " ")
            if self._robot.current > told:
                told = self._robot.current
                print(
                    f"waypoint {told} of {len(self._robot.visits)} after {now - self._fleet.began:.0f} s",
                    flush=True,
                )
            with self._group.changed:
                self._group.changed.wait(SAMPLE)
        return ""

    def _cpu(self) -> dict[str, float]:
        self._group.sample(self._account)
        return {name: usage.cpu for name, usage in self._account.usage().items()}

    def _tour(
        self, floor: Floor, map_file: Path, wall: float, before: dict[str, float], fault: str
    ) -> Tour:
        robot, seconds = self._robot, self._fleet.simulator.time - self._fleet.began
        cpu = {name: (used - before.get(name, 0.0)) / seconds for name, used in self._cpu().items()}
        mean, p95, greatest = robot.error_statistics()
        return Tour(
            condition=self._config.condition,
            seed=self._config.seed,
            waypoints=len(robot.visits),
            reached=robot.reached,
            seconds=seconds,
            wall=wall,
            way=robot.path_length,
            shortest=sum(visit.leg.length for visit in robot.visits),
            collisions=robot.collisions,
            clearance=_clearance(floor, robot.driven),
            error_mean=mean,
            error_p95=p95,
            error_max=greatest,
            cpu=cpu,
            rss={name: usage.rss / 1e6 for name, usage in self._account.usage().items()},
            map_iou=self._map_iou(map_file),
            fault=fault,
        )

    def _map_iou(self, map_file: Path) -> float | None:
        if not self._condition.mapping:
            return None
        return map_quality.agreement(
            grid_from_message(self._map), read_map(map_file), _planar(self._start)
        )


def _planar(pose: Pose) -> navigation.Pose:
    return navigation.Pose(pose.x, pose.y, pose.yaw)


def _clearance(floor: Floor, driven: list[tuple[float, float]]) -> float:
    """Returns the least distance [m] of the driven path from cells that are not free."""
    clearance = floor.clearance()
    return min((float(clearance[floor.cell(x, y)]) for x, y in driven), default=math.nan)


def start_pose(world: str) -> Pose:
    """Returns pioneer1's start pose in that world."""
    pose = read_poses(poses_of_world(world))[ROBOT]
    return Pose(pose["x"], pose["y"], pose["a"])


def main(argv: list[str]) -> int:
    """Runs the setting given as JSON; prints a line per waypoint and at the end the results as JSON."""
    config = TourConfig(**json.loads(argv[0]))
    start, condition = start_pose(config.world), CONDITIONS[config.condition]
    map_file = Path(rospkg.RosPack().get_path("pioneer_gazebo")) / "map" / f"{config.world}.yaml"
    arguments = {
        "world_name": config.world, "x": start.x, "y": start.y, "yaw": start.yaw, "seed": config.seed,
        "real_time_factor": config.real_time_factor, "odometry_scale": condition.odometry_scale,
        "mapping": str(condition.mapping).lower(),
    }  # fmt: skip
    with Master() as master, ProcessGroup() as group:
        os.environ.update(master.environment)
        log = master.home / "roslaunch.log"
        command = [
            "roslaunch",
            "pioneer_bench",
            "one_robot.launch",
            *(f"{k}:={v}" for k, v in arguments.items()),
        ]
        group.start("roslaunch", command, master.environment, log)
        rospy.init_node("pioneer_bench", disable_signals=True, disable_rostime=True)
        try:
            tour = TourNode(config, start, group).run(map_file)
        except HarnessError as error:
            print(f"{error}\n{last_lines(log)}", flush=True)
            return 1
        print(json.dumps(dataclasses.asdict(tour)), flush=True)
        rospy.signal_shutdown("measured")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
