"""Drives a robot over a course with this workspace's navigation, without ROS, many times faster than real time.

Navigation is ``nav_bundle.move_base.navigator`` on its costmaps, with move_base's parameters; the laser is the
simulator's. The body is kinematic, with the simulator's drive: on contact it stops, while the wheels keep turning.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Picture, points_from_ranges
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.costmap.config import ObstacleConfig
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.move_base.config import setup_from_parameters
from nav_bundle.move_base.navigator import Cycle, Navigator, Sight
from nav_bundle.move_base.state_machine import Outcome
from pioneer_bench.core.course import Course
from pioneer_gazebo.laser.laser import WallIndex
from pioneer_gazebo.laser.laser_kernel import Fan, Sensor
from pioneer_gazebo.world.section import Section

_BEAMS, _REACH, _NOISE, _LASER_X = 180, 30.0, 0.01, 0.08
_STEP = 0.01
_SCAN_PERIOD = 0.1
_ACCELERATION = 4.0
"""Acceleration of a wheel's rim [m/s²], as in the simulator."""
_HALF_TRACK = 0.165
_TOUCH = 0.004
"""Gap [m] below which the body counts as touching."""
_SLOW = 0.2
"""Speed [m/s] below which driving counts as slow."""
_CAREFUL = 0.1
"""Gap [m] below which every step of the body is checked for contact."""
BODY = np.array([[0.20, 0.20], [0.20, -0.20], [-0.30, -0.20], [-0.30, 0.20]])
"""Corners (x, y) of the parameters' footprint without padding [m]."""


@dataclass
class Ride:
    """Results of one course."""

    goals: int  #: number of goals
    reachable: int = 0  #: number of goals that can be reached
    reached: int = 0  #: goals reached
    seconds: float = 0.0  #: simulated [s]
    way: float = 0.0  #: path length driven [m]
    contacts: int = 0  #: number of contacts of the body
    clearance: float = math.inf  #: least gap between body and obstacles [m]
    recoveries: int = 0  #: recovery behaviours started
    given_up: tuple[float, ...] = ()  #: time until each aborted goal was given up [s]
    stuck: bool = False  #: whether the time limit was exceeded
    last: str = ""  #: the last warning
    reasons: tuple[str, ...] = ()  #: why each aborted goal was given up
    wrongly_given_up: int = 0  #: goals given up although they can be reached
    turned: float = 0.0  #: sum of all turns [rad]
    reverse: float = 0.0  #: time driven backwards [s]
    slow: float = 0.0  #: time below 0.2 m/s [s]

    def summary(self) -> str:
        """Returns a summary in one line."""
        line = (
            f"{self.reached} of {self.goals} in {self.seconds:.0f} s, {self.way:.0f} m, {self.contacts} contacts, "
            f"least gap {self.clearance:.2f} m, {self.recoveries} recoveries"
        )
        return f"{line}; out of time: {self.last}" if self.stuck else line


class Body:
    """The robot's true pose, wheel odometry, velocity and gap to obstacles."""

    def __init__(self, course: Course) -> None:
        self.pose = self.odom = course.start
        self.velocity, self.contacts = STANDSTILL, 0
        self._touches = False
        self.turned = 0.0
        self.surround(Section.joined([course.standing, course.low]))

    def surround(self, standing: Section) -> None:
        """Sets the obstacles."""
        self._segments, self._circles = standing.segments, standing.circles
        self.gap = self._gap(self.pose)

    def _gap(self, pose: Pose) -> float:
        """Returns the distance from the footprint to the nearest obstacle [m]; infinite beyond 2 m."""
        cosine, sine = math.cos(pose.yaw), math.sin(pose.yaw)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        starts = (self._segments[:, :2] - (pose.x, pose.y)) @ turn
        along = self._segments[:, 2:] @ turn
        near = _distances(np.zeros((1, 2)), starts, along)[0] < 2.0
        starts, along = starts[near], along[near]
        found = [math.inf]
        if len(starts):
            found.append(float(_distances(BODY, starts, along).min()))
            found.append(float(_distances(starts, BODY, _EDGES).min()))
        centres = (self._circles[:, :2] - (pose.x, pose.y)) @ turn
        if len(centres):
            found.append(
                float((_distances(centres, BODY, _EDGES).min(axis=1) - self._circles[:, 2]).min())
            )
        return min(found)

    def drive(self, command: Velocity, time: float) -> float:
        """Follows ``command`` for ``time`` [s]; returns the distance driven [m]."""
        way = 0.0
        for _ in range(round(time / _STEP)):
            self.velocity = _ramped(self.velocity, command)
            step = Pose(self.velocity.x * _STEP, 0.0, self.velocity.turn * _STEP)
            moved, self.odom = self.pose.compose(step), self.odom.compose(step)
            if self.gap < _CAREFUL:
                gap = self._gap(moved)
                touches = gap < _TOUCH and gap <= self.gap
                self.contacts += touches and not self._touches
                self._touches = touches
                if touches:
                    continue
                self.gap = gap
            way += abs(self.velocity.x) * _STEP
            self.turned += abs(self.velocity.turn) * _STEP
            self.pose = moved
        self.gap = self._gap(self.pose)
        return way


_EDGES = np.roll(BODY, -1, axis=0) - BODY


def _distances(
    points: NDArray[np.float64], starts: NDArray[np.float64], along: NDArray[np.float64]
) -> Any:
    """Returns the distances [m] of (n, 2) points from m segments, shape (n, m)."""
    offset = points[:, None, :] - starts[None]
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    part = np.clip((offset * along[None]).sum(axis=2) / length, 0.0, 1.0)
    away = offset - part[:, :, None] * along[None]
    return np.hypot(away[:, :, 0], away[:, :, 1])


def _ramped(velocity: Velocity, command: Velocity) -> Velocity:
    """Returns the velocity after one step; both wheels ramp in proportion."""
    x, turn = command.x - velocity.x, command.turn - velocity.turn
    gap = max(abs(x - turn * _HALF_TRACK), abs(x + turn * _HALF_TRACK))
    part = min(1.0, _ACCELERATION * _STEP / gap) if gap > 0.0 else 1.0
    return Velocity(velocity.x + part * x, 0.0, velocity.turn + part * turn)


class Rider:
    """One robot on one course.

    Args:
        course: the course.
        parameters: of move_base, as ``rospy.get_param("~")`` returns them; any frame names are accepted.
        seed: of the laser noise and of the command periods.
        jitter: how irregular the control loop is: each command period is drawn from the nominal one to
            ``1 + jitter`` times as long.
    """

    def __init__(
        self, course: Course, parameters: Mapping[str, Any], seed: int = 0, jitter: float = 0.0
    ) -> None:
        setup = setup_from_parameters(parameters, "move_base")
        self._course, self._setup = course, setup
        self.body = Body(course)
        self._index = WallIndex(course.standing)
        self._generator = np.random.default_rng(seed)
        self._ranges = np.empty(_BEAMS)
        self._global, self._local = Costmap(setup.global_costmap), Costmap(setup.local_costmap)
        for costmap in (self._global, self._local):
            costmap.set_map(course.grid())
        self.navigator = Navigator(setup, self._global, self._local, self._refresh)
        self._points = np.empty((0, 2))
        self._scanned = self.body.pose, self.body.odom
        self._period = 1.0 / setup.base.controller_frequency
        self._jitter = jitter
        self._delays = np.random.default_rng([seed, 1])
        self._changes = list(course.changes)
        self.now = 0.0
        self._due = dict.fromkeys(("scan", "global", "local"), 0.0)
        self.ride = Ride(len(course.goals), len(course.goals) - len(course.unreachable))
        self._command = STANDSTILL

    def run(self) -> Ride:
        """Drives to all goals until the course's time limit; returns the results."""
        for leg, goal in enumerate(self._course.goals):
            if not self._drive_to(goal, leg):
                break
        self.ride.seconds, self.ride.contacts = self.now, self.body.contacts
        self.ride.turned = self.body.turned
        return self.ride

    def _change(self, leg: int) -> None:
        """Carries out the changes that the robot has come near enough for."""
        for change in list(self._changes):
            if (
                change.leg == leg
                and self.body.pose.distance(Pose(change.x, change.y)) < change.distance
            ):
                self._changes.remove(change)
                standing = Section.joined([*self._course.walls, change.hidden])
                self._index = WallIndex(standing)
                self.body.surround(Section.joined([standing, self._course.low]))

    def _drive_to(self, goal: Pose, leg: int) -> bool:
        """Drives to one goal; returns False if the time limit is exceeded."""
        begun = self.now
        self._look()
        self._take(self.navigator.begin(goal, self.body.pose, self.now))
        while self.now < self._course.limit:
            self._change(leg)
            self._look()
            pose, odom = self.body.pose, self.body.odom
            sight = Sight(pose, odom, odom.compose(pose.inverse()), self.body.velocity, True)
            result = self.navigator.cycle(sight, self.now)
            waited = round(self.now - begun, 3)
            self._take(result)
            if result.finish is not None:
                if result.finish.outcome is Outcome.SUCCEEDED:
                    self.ride.reached += 1
                else:
                    self.ride.given_up += (waited,)
                    self.ride.reasons += (result.finish.text,)
                    self.ride.wrongly_given_up += leg not in self._course.unreachable
                return True
        self.ride.stuck = True
        return False

    def _take(self, result: Cycle) -> None:
        """Executes the navigator's command for one period."""
        self._command = self._command if result.command is None else result.command
        period = self._period
        if self._jitter > 0.0:
            steps = self._delays.uniform(1.0, 1.0 + self._jitter) * self._period / _STEP
            period = round(steps) * _STEP
        self.ride.way += self.body.drive(self._command, period)
        self.ride.reverse += period * (self.body.velocity.x < 0.0)
        self.ride.slow += period * (abs(self.body.velocity.x) < _SLOW)
        self.ride.clearance = min(self.ride.clearance, self.body.gap)
        self.ride.recoveries += result.recovery is not None
        if result.warnings:
            self.ride.last = result.warnings[-1]
        self.now += period

    def _is_due(self, name: str, period: float) -> bool:
        due = self.now >= self._due[name] - 1.0e-6
        if due:
            self._due[name] = self.now + period
        return due

    def _look(self) -> None:
        """Takes a scan and updates the costmaps, each if it is due."""
        if self._is_due("scan", _SCAN_PERIOD):
            self._scan()
        if self._is_due("global", 1.0 / self._setup.global_costmap.update_frequency):
            self._update(self._global, self.body.pose)
            self.navigator.look_around(self.body.pose, self.now)
        if self._is_due("local", 1.0 / self._setup.local_costmap.update_frequency):
            self._update(self._local, self.body.odom)
            self.navigator.look_at(Picture(*self._seen(self._scanned[1])))

    def _refresh(self) -> None:
        self._update(self._global, self.body.pose)
        self._update(self._local, self.body.odom)

    def _seen(self, pose: Pose) -> tuple[Pose, NDArray[np.float64]]:
        """Returns the laser's pose at the last scan and the scan's points, for a robot at ``pose``."""
        cosine, sine = math.cos(pose.yaw), math.sin(pose.yaw)
        x, y = pose.apply(_LASER_X, 0.0)
        points = np.ascontiguousarray(
            self._points @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)
        )
        return Pose(x, y, pose.yaw), points

    def _update(self, costmap: Costmap, pose: Pose) -> None:
        sensor, points = self._seen(self._scanned[costmap is self._local])
        layers = [layer for layer in costmap.config.layers if isinstance(layer, ObstacleConfig)]
        sources = [source for layer in layers for source in layer.sources]
        costmap.update(
            pose,
            [Observation(source, sensor.x, sensor.y, points, sensor.yaw) for source in sources],
        )

    def _scan(self) -> None:
        pose = self.body.pose
        x, y = pose.apply(_LASER_X, 0.0)
        step = math.tau / (_BEAMS - 1)
        self._index.cast(Sensor(x, y, pose.yaw), Fan(-math.pi, step, _REACH), self._ranges)
        seen = self._ranges < _REACH
        noisy = np.where(
            seen, self._ranges + self._generator.normal(0.0, _NOISE, _BEAMS), np.inf
        ).astype(np.float32)
        self._points = points_from_ranges(noisy, -math.pi, step, 0.1, _REACH, False)[:, :2]
        self._scanned = pose, self.body.odom


def ride(course: Course, parameters: Mapping[str, Any], seed: int = 0, jitter: float = 0.0) -> Ride:
    """Drives ``course`` and returns the results; ``jitter`` is that of ``Rider``."""
    return Rider(course, parameters, seed, jitter).run()


def with_changes(parameters: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the parameter tree with ``changes`` applied; their keys may be paths: ``local_costmap/width``."""
    tree = dict(parameters)
    for name, value in changes.items():
        first, _, rest = name.partition("/")
        tree[first] = with_changes(tree.get(first, {}), {rest: value}) if rest else value
    return tree
