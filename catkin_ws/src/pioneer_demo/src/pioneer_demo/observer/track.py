"""Record of one robot's run: path, waypoints and localisation error."""

import collections
import dataclasses
import math

import numpy as np

from pioneer_demo.scenario.waypoint import Leg
from pioneer_fleet.geometry import Points, Pose, pose_at, remaining_length
from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_fleet.monitor.monitor import RobotMonitor
from pioneer_fleet.monitor.state import Activity, State

_MOVED = 0.05
_PATH_STEP = 0.05
_ERROR_INTERVAL = 0.1
_ODOMETRY_KEPT = 400
_RESTART = 0.5
"""A stamp that is older by more than this [s] is of a clock that was reset; less is a message that came late."""


@dataclasses.dataclass
class Visit:
    """Progress of one waypoint."""

    leg: Leg  #: its goal and the demo's route to it
    planned: Points = dataclasses.field(
        default_factory=list
    )  #: move_base's first plan towards it, in ``map``
    reached: bool | None = None  #: whether it was reached; None while pending
    time: float = math.nan  #: simulated time when it was reached or given up [s]
    distance: float = math.nan  #: true distance to the waypoint at that time [m]


class RobotTrack:
    """Collects one robot's messages. Times are simulated seconds, positions in ``map``.

    The localisation error is the distance between the true position and ``map → odom → base_link``, composed of the
    newest correction and the odometry interpolated at the stamp of the true position; evaluated ten times a second.
    """

    def __init__(self, name: str, is_external: bool = False) -> None:
        self.name = name
        self.is_external = (
            is_external  #: whether another navigation drives it, of which we see nothing
        )
        self.monitor = RobotMonitor()
        self.visits: list[Visit] = []
        self.pose: Pose | None = None
        self.driven: Points = []  # from its first known position
        self.path_length = 0.0
        self.first_motion: float | None = None
        self.collisions = 0
        self.errors: list[float] = []
        self.plan: Points = []
        self.status = ""
        self._moved_to: tuple[float, float] | None = None
        self._stamp = self._picked = -math.inf
        self._correction: Pose | None = None
        self._odometry: collections.deque[tuple[float, Pose]] = collections.deque(
            maxlen=_ODOMETRY_KEPT
        )
        self._unjudged: collections.deque[tuple[float, Pose]] = collections.deque(
            maxlen=_ODOMETRY_KEPT
        )

    @property
    def queue(self) -> Queue | None:
        """The waypoint client's newest report."""
        return self.monitor.queue

    @property
    def state(self) -> State:
        """What the robot is doing; with waypoints of a demo, also that it has reached or given up all of them."""
        if self.finished:
            given_up = len(self.visits) - self.reached
            if given_up:
                return State(Activity.FAILED, f"gave up {given_up}")
            return State(Activity.IDLE, "done")
        if self.pose is None:
            return State(Activity.STARTING, "not spawned")
        if self.is_external:
            return State(Activity.MANUAL, "driven by another navigation")
        if not self.localised:
            return State(Activity.STARTING, "waiting for amcl")
        return self.monitor.state

    @property
    def localised(self) -> bool:
        """Whether a map → odom correction has arrived."""
        return self._correction is not None

    @property
    def finished(self) -> bool:
        """Whether every waypoint was reached or given up."""
        return bool(self.visits) and all(visit.reached is not None for visit in self.visits)

    @property
    def reached(self) -> int:
        """Number of waypoints reached."""
        return sum(visit.reached is True for visit in self.visits)

    @property
    def current(self) -> int:
        """Index of the current waypoint; the number of waypoints if none is left."""
        return sum(visit.reached is not None for visit in self.visits)

    @property
    def error(self) -> float:
        """The newest localisation error [m], nan before the first."""
        return self.errors[-1] if self.errors else math.nan

    @property
    def distance_to_go(self) -> float:
        """Remaining distance to the current waypoint [m], along the plan if there is one; nan if unknown."""
        if self.pose is None or self.current >= len(self.visits):
            return math.nan
        goal = self.visits[self.current].leg.goal
        if self.plan and math.dist(self.plan[-1], (goal.x, goal.y)) < 0.5:
            return remaining_length(self.plan, (self.pose.x, self.pose.y))
        return self.pose.distance(goal)

    def error_statistics(self) -> tuple[float, float, float]:
        """Returns mean, 95th percentile and maximum of the localisation error [m]; nan without any."""
        if not self.errors:
            return math.nan, math.nan, math.nan
        return float(np.mean(self.errors)), float(np.percentile(self.errors, 95)), max(self.errors)

    def assign(self, legs: list[Leg]) -> None:
        """Sets the waypoints sent to the robot, in order."""
        self.visits = [Visit(leg) for leg in legs]

    def move(self, to: tuple[float, float]) -> None:
        """Announces that the simulator is asked to put the robot elsewhere: that is no way that it drives."""
        self._moved_to = to

    def add_truth(self, stamp: float, pose: Pose) -> None:
        """Adds a true pose of ``base_link``; ignores one older than the last, unless simulated time began again."""
        if stamp < self._stamp - _RESTART:
            self._restart_clock()
        if stamp < self._stamp:
            return
        self._stamp, self.pose = stamp, pose
        self.monitor.pose = (pose.x, pose.y, pose.yaw)
        self._extend_path(stamp, pose)
        if self.localised and stamp - self._picked >= _ERROR_INTERVAL:
            self._picked = stamp
            self._unjudged.append((stamp, pose))
        self._judge()

    def add_odometry(self, stamp: float, pose: Pose) -> None:
        """Adds a transform odom → base_link."""
        if self._odometry and stamp < self._odometry[-1][0] - _RESTART:
            self._restart_clock()
        if not self._odometry or stamp > self._odometry[-1][0]:
            self._odometry.append((stamp, pose))
            self._judge()

    def add_correction(self, pose: Pose) -> None:
        """Sets the newest transform map → odom."""
        self._correction = pose

    def add_plan(self, points: Points) -> None:
        """Adds a global plan; ignores an empty one."""
        if points:
            self.plan = points
            if self.current < len(self.visits) and not self.visits[self.current].planned:
                goal = self.visits[self.current].leg.goal
                if math.dist(points[-1], (goal.x, goal.y)) < 0.5:
                    self.visits[self.current].planned = points

    def add_queue(self, queue: Queue) -> None:
        """Processes the waypoint client's report and closes the visits that it reports as reached or aborted."""
        before = self.queue or Queue(ClientState.IDLE, 0, 0, 0, "")
        self.monitor.queue = queue
        self._close(queue.aborted - before.aborted, False)
        self._close(queue.reached - before.reached, True)

    def _close(self, count: int, reached: bool) -> None:
        """Closes so many visits, or all that are left: a message may give any number."""
        for visit in self.visits[self.current :][: max(0, count)]:
            visit.time = self._stamp
            visit.distance = self.pose.distance(visit.leg.goal) if self.pose else math.nan
            visit.reached = reached

    def _extend_path(self, stamp: float, pose: Pose) -> None:
        point = (pose.x, pose.y)
        if not self.driven:
            self.driven.append(point)
        step = math.dist(point, self.driven[-1])
        if self._moved_to is not None and math.dist(point, self._moved_to) < step:
            self._moved_to = None
            self.driven.append(point)
            return
        if self.first_motion is None and step > _MOVED:
            self.first_motion = stamp
        if step >= _PATH_STEP:
            self.driven.append(point)
            self.path_length += step

    def _restart_clock(self) -> None:
        """Forgets what has stamps of before a reset of the simulation."""
        self._stamp = -math.inf
        self._picked = -math.inf
        self._odometry.clear()
        self._unjudged.clear()

    def _judge(self) -> None:
        """Computes errors for true poses once odometry before and after their stamps is available."""
        while self._unjudged and self._odometry and self._unjudged[0][0] <= self._odometry[-1][0]:
            stamp, truth = self._unjudged.popleft()
            odometry = pose_at(self._odometry, stamp)
            if odometry is not None and self._correction is not None:
                self.errors.append(self._correction.compose(odometry).distance(truth))
