"""The move_base node: costmaps, planners and recovery behind one action."""

import math
import threading
from dataclasses import replace

import numpy as np
import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import RecoveryStatus
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as PathType
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from numpy.typing import NDArray
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from nav_bundle.conversions import check_numbers, path_message, stamped_from_pose, velocity_from_odometry
from nav_bundle.core.error import MessageError
from nav_bundle.core.global_planner import visible_potential
from nav_bundle.core.local_planner import Decision, LocalPlannerError, Situation, Velocity
from nav_bundle.core.move_base import (
    Event,
    Finish,
    FollowPlan,
    Inputs,
    Phase,
    PlanOutcome,
    StartPlanning,
    StartRecovery,
    State,
    StopPlanning,
    Warn,
    advance,
)
from nav_bundle.core.move_base_config import Setup, setup_from_parameters
from nav_bundle.core.navfn import MEETING_DISTANCE, NavfnSearch
from nav_bundle.core.planner import GoalOutsideError, NoPathError, Path, PlannerError, Search, path_between
from nav_bundle.core.pose import Pose
from nav_bundle.core.recovery import Recovery, Surroundings
from nav_bundle.core.transform import TransformError
from nav_bundle.nodes.costmap import CostmapNode
from nav_bundle.nodes.move_base_action import GoalServer
from nav_bundle.nodes.move_base_reconfigure import Reconfiguration
from nav_bundle.nodes.sensor import newest_odometry
from nav_bundle.nodes.transform import TransformListener
from pioneer_node.nodes import entry

# How many cells a search may look at in one cycle: about 60 ms while the robot stands, 8 ms while it drives.
_CELLS_STANDING, _CELLS_DRIVING = 2_000_000, 250_000
_COMPLAIN_EVERY = 5.0
_NOBODY = np.empty((0, 2))
_BUSY = "move_base must be in an inactive state to make a plan for an external user"
_NO_START = "move_base cannot make a plan for you because it could not get the start pose of the robot"


class MoveBaseNode:
    """Drives the robot to goals.

    Subscribes: ``odom`` (nav_msgs/Odometry), tf, what the costmaps subscribe to (``nodes.costmap``), goals
        (``nodes.move_base_action``).

    Publishes: ``cmd_vel`` (geometry_msgs/Twist), ``~<global planner>/plan``, ``~<local planner>/global_plan``,
        ``~<local planner>/local_plan`` (nav_msgs/Path), ``~recovery_status`` (move_base_msgs/RecoveryStatus), and
        what costmaps and action publish. The global planner is NavfnROS or
        GlobalPlanner (which also shows its ``potential``), the local planner TrajectoryPlannerROS or DWAPlannerROS.

    Services: ``~make_plan`` (nav_msgs/GetPlan), ``~clear_costmaps`` (std_srvs/Empty).

    Parameters: ``core.move_base_config``, read at start; many may change later (``nodes.move_base_reconfigure``).

    Threads: rospy's threads store messages; one loop at ``controller_frequency`` of ROS time does all the
        work on them; services take turns with it.

    On error: without recent scans, odometry or transforms the robot is told to stand still in every cycle,
        and the node says what it misses.
    """

    def __init__(self) -> None:
        self._parameters = entry.parameters()
        self._setup: Setup = setup_from_parameters(self._parameters, rospy.get_name())
        self._listener = TransformListener(future_limit=self._setup.base.transform_future_limit)
        self._global = CostmapNode("global_costmap", self._setup.global_costmap, self._listener)
        self._local = CostmapNode("local_costmap", self._setup.local_costmap, self._listener)
        self._listener.listen(self._local.frame, self._global.frame)
        self._planner = self._setup.make_global_planner()
        self._controller = self._setup.make_local_planner()
        self._state = State()
        self._goal: Pose | None = None
        self._search: Search | None = None
        self._path: Path | None = None
        self._route: Path | None = None
        self._recovery: Recovery | None = None
        self._strangers = _NOBODY
        self._turn = threading.RLock()
        self._rate = rospy.Rate(self._setup.base.controller_frequency, reset=True)
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True)
        self._advertise_plans()
        self._recovery_status = rospy.Publisher("~recovery_status", RecoveryStatus, queue_size=1)

    def _advertise_plans(self) -> None:
        name = self._setup.local_planner_name
        self._plan = rospy.Publisher(f"~{self._setup.global_planner_name}/plan", PathType, queue_size=1)
        potential = f"~{self._setup.global_planner_name}/potential"
        self._potential = (
            rospy.Publisher(potential, OccupancyGrid, queue_size=1) if self._setup.potential_scale else None
        )
        self._followed = rospy.Publisher(f"~{name}/global_plan", PathType, queue_size=1)
        self._driven = rospy.Publisher(f"~{name}/local_plan", PathType, queue_size=1)

    def _adopt(self, setup: Setup) -> None:
        """Goes on with other parameters: costmaps keep what they know, the plan under way is followed on."""
        with self._turn:
            before, self._setup = self._setup, setup
            self._global.configure(setup.global_costmap)
            self._local.configure(setup.local_costmap)
            if (setup.global_planner_name, setup.global_planner) != (before.global_planner_name, before.global_planner):
                self._planner = setup.make_global_planner()
            if not setup.drives_as(before):
                self._controller = setup.make_local_planner()
                if self._route is not None:
                    self._controller.set_plan(self._route)
            if setup.base.controller_frequency != before.base.controller_frequency:
                self._rate = rospy.Rate(setup.base.controller_frequency, reset=True)
            names = ("local_planner_name", "global_planner_name", "potential_scale")
            if any(getattr(setup, name) != getattr(before, name) for name in names):
                for publisher in filter(None, (self._plan, self._potential, self._followed, self._driven)):
                    publisher.unregister()
                self._advertise_plans()

    def spin(self) -> None:
        """Waits for what navigation needs, then runs the loop until shutdown."""
        if not self._wait():
            return
        self._goals = GoalServer("move_base", self._global.frame, self._listener, self._goal_fault)
        self._odometry = newest_odometry("odom")
        self._services = [
            rospy.Service("~make_plan", GetPlan, self._make_plan),
            rospy.Service("~clear_costmaps", Empty, self._clear_costmaps),
        ]
        self._reconfiguration = Reconfiguration(self._parameters, self._setup, self._adopt)
        last, heard = 0.0, False
        while not rospy.is_shutdown():
            now = rospy.get_time()
            with self._turn:
                if now < last:
                    self._forget(now)
                self._cycle(now)
            if not heard and self._odometry.received is not None:
                heard = True
                rospy.loginfo("odom received!")
            last = now
            self._rate.sleep()
        self._velocity.publish(Twist())

    def _wait(self) -> bool:
        """Updates the costmaps until both are complete, and says what they wait for; False at shutdown."""
        while not rospy.is_shutdown():
            now = rospy.get_time()
            missing = self._global.missing(now) + self._local.missing(now)
            self._global.update(now)
            self._local.update(now)
            if not missing and self._global.costmap.ready and self._local.costmap.ready:
                return True
            if missing:
                words = ", ".join(dict.fromkeys(missing))
                rospy.loginfo_throttle(_COMPLAIN_EVERY, f"waiting for {words}")
            self._rate.sleep()
        return False

    def _forget(self, now: float) -> None:
        """Starts over after a clock that jumped back; the goal under way stays."""
        rospy.logwarn("time jumped back: obstacles forgotten, the goal is planned anew")
        for costmap in (self._global, self._local):
            costmap.forget()
        self._odometry.forget()
        self._goals.forget()
        if self._goal is not None:
            self._state, _, events = advance(self._state, Inputs(new_goal=True), now, self._setup.limits)
            self._handle(events)

    def _cycle(self, now: float) -> None:
        if self._global.update(now):
            pose = self._global.pose(now)
            self._strangers = _NOBODY if pose is None else self._global.costmap.strangers(pose, MEETING_DISTANCE)
        self._local.update(now)
        inputs = self._inputs(now)
        self._state, command, events = advance(self._state, inputs, now, self._setup.limits)
        if command is not None:
            self._drive(command)
        self._handle(events)
        if inputs.pose is not None and self._state.phase is not Phase.IDLE:
            self._goals.report(inputs.pose, now)

    def _goal_fault(self, goal: Pose) -> str:
        return "" if self._setup.global_planner.default_tolerance else self._global.costmap.goal_fault(goal)

    def _inputs(self, now: float) -> Inputs:
        """Gathers what happened since the last cycle, local planner and recovery included."""
        goal = self._goals.take()
        if goal is not None:
            self._goal = goal
            return Inputs(new_goal=True, pose=self._global.pose(now))
        if self._state.phase is Phase.IDLE:
            return Inputs()
        if not self._goals.active:
            return Inputs(cancel=True)
        pose, local_pose = self._global.pose(now), self._local.pose(now)
        current = pose is not None and local_pose is not None and self._is_current(now)
        inputs = Inputs(cancel=self._goals.cancelled(), pose=pose, current=current, meeting=len(self._strangers) > 0)
        if inputs.cancel or not current:
            return inputs
        assert pose is not None
        assert local_pose is not None
        inputs = replace(inputs, plan=self._search_on())
        if self._state.phase is Phase.CONTROLLING:
            decision = self._decide(local_pose, now)
            return inputs if decision is None else replace(inputs, control=decision.velocity, reached=decision.reached)
        if self._recovery is not None:
            velocity = self._recovery.step(Surroundings(self._global.costmap, pose, self._local.costmap, local_pose))
            if velocity is None:
                self._end_recovery(now)
            return replace(inputs, recovery=velocity, recovered=velocity is None)
        return inputs

    def _is_current(self, now: float) -> bool:
        age = self._odometry.age(now)
        timeout = self._setup.base.odom_timeout
        if age is None or (0.0 < timeout < age):
            rospy.logwarn_throttle(_COMPLAIN_EVERY, "no odometry on %s: standing still", self._odometry.topic)
            return False
        return self._global.is_current(now) and self._local.is_current(now)

    def _search_on(self) -> PlanOutcome:
        """Goes on with the search under way."""
        if self._search is None:
            return PlanOutcome.NONE
        driving = self._state.phase is Phase.CONTROLLING
        try:
            self._path = self._search.advance(_CELLS_DRIVING if driving else _CELLS_STANDING)
        except PlannerError as error:
            rospy.logwarn_throttle(_COMPLAIN_EVERY, str(error))
            self._search = None
            return PlanOutcome.FAILED
        if self._path is None:
            return PlanOutcome.NONE
        self._show_potential(self._search)
        self._search = None
        return PlanOutcome.FOUND

    def _show_potential(self, search: Search) -> None:
        publisher, costmap = self._potential, self._global.costmap
        if publisher is None or not publisher.get_num_connections() or not isinstance(search, NavfnSearch):
            return
        if search.potential.shape == costmap.cells.shape:
            values = visible_potential(search.potential, self._setup.potential_scale)
            publisher.publish(self._global.grid_of(values, rospy.get_time()))

    def _decide(self, local_pose: Pose, now: float) -> Decision | None:
        """Asks the local planner; None where it finds nothing to drive."""
        try:
            transform = self._listener.lookup(self._local.frame, self._global.frame).planar()
            velocity = velocity_from_odometry(self._odometry.messages()[0])
            strangers = _moved(self._strangers, transform)
            situation = Situation(self._local.costmap, local_pose, velocity, transform, strangers)
            decision = self._controller.decide(situation)
        except (LocalPlannerError, TransformError, MessageError) as error:
            rospy.logwarn_throttle(_COMPLAIN_EVERY, str(error))
            return None
        self._show(self._followed, decision.global_plan, self._local.frame, now)
        self._show(self._driven, decision.local_plan, self._local.frame, now)
        return decision

    def _show(self, publisher: rospy.Publisher, path: Path, frame: str, now: float) -> None:
        if publisher.get_num_connections():
            publisher.publish(path_message(path, frame, rospy.Time.from_sec(now)))

    def _drive(self, command: Velocity) -> None:
        message = Twist()
        message.linear.x, message.linear.y, message.angular.z = command.x, command.y, command.turn
        self._velocity.publish(message)

    def _handle(self, events: tuple[Event, ...]) -> None:
        for event in events:
            match event:
                case StartPlanning():
                    self._start_planning()
                case StopPlanning():
                    self._search = None
                case FollowPlan():
                    self._follow()
                case StartRecovery(index, trigger):
                    self._start_recovery(index, trigger.name)
                case Finish(outcome, text):
                    self._goal, self._route, self._recovery = None, None, None
                    self._goals.finish(outcome, text)
                case Warn(text):
                    rospy.logwarn_throttle(_COMPLAIN_EVERY, f"[{rospy.get_name()}]:{text}")
        if self._state.phase is not Phase.CLEARING:
            self._recovery = None

    def _start_planning(self) -> None:
        """Begins a search; a start or goal outside the map becomes a search that fails."""
        pose = self._global.pose(rospy.get_time())
        assert self._goal is not None
        try:
            if pose is None:
                raise PlannerError("Unable to get starting pose of robot, unable to create global plan")
            self._search = self._planner.search(self._global.costmap, pose, self._goal)
        except PlannerError as error:
            self._search = _FailedSearch(error)

    def _follow(self) -> None:
        assert self._path is not None
        self._route = self._path
        self._controller.set_plan(self._route)
        self._show(self._plan, self._route, self._global.frame, rospy.get_time())

    def _start_recovery(self, index: int, trigger: str) -> None:
        recovery = self._setup.recoveries[index]
        rospy.logwarn("recovery behavior %d of %d: %s", index + 1, len(self._setup.recoveries), recovery.name)
        recovery.start()
        self._recovery = recovery
        if self._recovery_status.get_num_connections():
            self._recovery_status.publish(self._status(index, trigger))

    def _end_recovery(self, now: float) -> None:
        """Shows what the behaviour changed before anything is planned on it."""
        assert self._recovery is not None
        if self._recovery.complaint:
            rospy.logwarn("%s", self._recovery.complaint)
        self._recovery = None
        self._global.update(now, forced=True)
        self._local.update(now, forced=True)

    def _status(self, index: int, trigger: str) -> RecoveryStatus:
        status = RecoveryStatus()
        now = rospy.get_time()
        pose = self._local.pose(now) or Pose()
        status.pose_stamped = stamped_from_pose(pose, self._local.frame, rospy.Time.from_sec(now))
        status.current_recovery_number = index
        status.total_number_of_recoveries = len(self._setup.recoveries)
        status.recovery_behavior_name = f"{self._setup.recoveries[index].name} ({trigger.lower()})"
        return status

    def _make_plan(self, request: GetPlanRequest) -> GetPlanResponse:
        """Plans for somebody else while no goal is under way; where nothing leads to the goal, the plan is empty."""
        with self._turn:
            if self._goals.active:
                raise rospy.ServiceException(_BUSY)
            now = rospy.Time.now()
            response = GetPlanResponse()
            response.plan.header.stamp, response.plan.header.frame_id = now, self._global.frame
            try:
                path = self._plan_for(request)
            except (NoPathError, GoalOutsideError) as error:
                rospy.logwarn("make_plan: %s", error)
                return response
            except (PlannerError, TransformError, MessageError) as error:
                raise rospy.ServiceException(str(error)) from error
            response.plan.poses = [stamped_from_pose(Pose(*pose), self._global.frame, now) for pose in path.tolist()]
            return response

    def _plan_for(self, request: GetPlanRequest) -> Path:
        check_numbers("make_plan", request)
        here = self._global.pose(rospy.get_time())
        start = self._goals.in_global_frame(request.start) if request.start.header.frame_id else here
        if start is None:
            raise PlannerError(_NO_START)
        goal = self._goals.in_global_frame(request.goal)
        return path_between(self._planner, self._global.costmap, start, goal, request.tolerance)

    def _clear_costmaps(self, _: EmptyRequest) -> EmptyResponse:
        with self._turn:
            now = rospy.get_time()
            for costmap in (self._global, self._local):
                costmap.costmap.reset()
                costmap.update(now, forced=True)
        return EmptyResponse()


def _moved(points: NDArray[np.float64], transform: Pose) -> NDArray[np.float64]:
    """Returns points (n, 2) in the parent frame of ``transform``."""
    cosine, sine = math.cos(transform.yaw), math.sin(transform.yaw)
    return points @ np.array([[cosine, sine], [-sine, cosine]]) + (transform.x, transform.y)


class _FailedSearch:
    """A search that could not begin."""

    def __init__(self, error: PlannerError) -> None:
        self._error = error

    def advance(self, budget: int) -> Path | None:
        """Raises the reason."""
        raise self._error


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("move_base", MoveBaseNode)
