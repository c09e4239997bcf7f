"""The move_base node: costmaps, planners and recovery behaviours behind one action."""

import threading
import time
from typing import NamedTuple

import numpy as np
import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import RecoveryStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.msg import Path as PathType
from nav_msgs.srv import GetPlanRequest
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from nav_bundle.base.clock import RESET, STALL, ClockWatch, Jump, StallWatch
from nav_bundle.base.conversions import check_numbers, stamped_from_pose
from nav_bundle.base.error import MessageError
from nav_bundle.base.pose import Pose
from nav_bundle.base.topics import TransformListener
from nav_bundle.base.transform import TransformError
from nav_bundle.base.velocity import Velocity
from nav_bundle.control.conversions import cost_cloud, velocity_from_odometry
from nav_bundle.costmap.node import CostmapNode
from nav_bundle.costmap.topics import Newest
from nav_bundle.move_base.action_server import GoalServer
from nav_bundle.move_base.config import Setup, setup_from_parameters
from nav_bundle.move_base.navigator import Cycle, Navigator, Report, Sight
from nav_bundle.move_base.reason import NO_REASON, Code, Condition, no_sensor_data
from nav_bundle.move_base.reason import Reason as ReportedReason
from nav_bundle.move_base.reconfigure import Reconfiguration, outline_parameters
from nav_bundle.move_base.state_machine import Phase, StartRecovery
from nav_bundle.move_base.state_topics import StatePublisher
from nav_bundle.move_base.topics import Reason
from nav_bundle.planning.conversions import GetPlanArray, GetPlanArrayResponse, PathMessage
from nav_bundle.planning.global_planner import visible_potential
from nav_bundle.planning.navfn import NavfnSearch
from nav_bundle.planning.planner import (
    GoalOutsideError,
    NoPathError,
    Path,
    PlannerError,
    Search,
    nearest_inside,
    with_goal,
)
from pioneer_node.nodes import entry
from pioneer_node.nodes.standing_warning import StandingWarning

_COMPLAIN_EVERY = 5.0
_CLOCK_PERIOD = 0.5
"""Time between two looks at the simulated clock [s of wall time]."""
_CELLS_AT_ONCE = 50_000
"""Cells that a service's search visits at once, about 2 ms: the loop waits for the interpreter as long."""
_BUSY = "move_base must be in an inactive state to make a plan for an external user"
_NO_START = (
    "move_base cannot make a plan for you because it could not get the start pose of the robot"
)


class _Shown(NamedTuple):
    """Publishers that visualise planning."""

    plan: rospy.Publisher
    followed: rospy.Publisher
    driven: rospy.Publisher
    costs: rospy.Publisher
    potential: rospy.Publisher | None

    @classmethod
    def of(cls, setup: Setup) -> "_Shown":
        """Returns the publishers in the planners' namespaces."""
        far, near = f"~{setup.global_planner_name}", f"~{setup.local_planner_name}"
        return cls(
            rospy.Publisher(f"{far}/plan", PathType, queue_size=1),
            rospy.Publisher(f"{near}/global_plan", PathType, queue_size=1),
            rospy.Publisher(f"{near}/local_plan", PathType, queue_size=1),
            rospy.Publisher(f"{near}/cost_cloud", PointCloud2, queue_size=1),
            rospy.Publisher(f"{far}/potential", OccupancyGrid, queue_size=1)
            if setup.potential_scale
            else None,
        )


class MoveBaseNode:
    """Drives the robot to goals.

    Subscribes: ``odom`` (nav_msgs/Odometry), tf, the costmaps' topics (``costmap.node``), goals
        (``move_base.action_server``).

    Publishes: ``cmd_vel`` (geometry_msgs/Twist), ``~<global planner>/plan``, ``~<local planner>/global_plan``,
        ``~<local planner>/local_plan`` (nav_msgs/Path), ``~<local planner>/cost_cloud`` (sensor_msgs/PointCloud2, with
        ``publish_cost_grid_pc``), ``~recovery_status`` (move_base_msgs/RecoveryStatus),
        ``~safety_stop`` (std_msgs/String, latched: why an input does not allow driving; else empty), and the topics of
        costmaps and action. The global planner is NavfnROS or GlobalPlanner (which also publishes its ``potential``),
        the local planner TrajectoryPlannerROS or DWAPlannerROS.

    Services: ``~make_plan`` (nav_msgs/GetPlan), ``~<global planner>/make_plan`` (also while the robot drives),
        ``~clear_costmaps`` (std_srvs/Empty).

    Parameters: ``move_base.config``, read at start; many can be changed at run time
        (``move_base.reconfigure``).

    Threads: rospy's threads store messages; one loop at ``controller_frequency`` (ROS time) processes them. Another
        thread watches simulated time, with which the loop stands still. A lock serialises both and the services.

    On error: without recent scans, odometry or transforms a zero velocity is published in every cycle,
        and the node logs what is missing. So it is while simulated time stands still.
    """

    def __init__(self) -> None:
        self._parameters = {**outline_parameters(), **entry.parameters()}
        self._setup: Setup = setup_from_parameters(self._parameters, rospy.get_name())
        self._listener = TransformListener(future_limit=self._setup.base.transform_future_limit)
        self._global = CostmapNode("global_costmap", self._setup.global_costmap, self._listener)
        self._local = CostmapNode("local_costmap", self._setup.local_costmap, self._listener)
        self._listener.listen(self._local.frame, self._global.frame)
        self._navigator = Navigator(
            self._setup, self._global.costmap, self._local.costmap, self._refresh
        )
        self._warned: dict[str, float] = {}
        self._in_trouble = False
        self._blind = StandingWarning("odometry and transforms have come again: driving on")
        self._turn = threading.RLock()
        self._rate = rospy.Rate(self._setup.base.controller_frequency, reset=True)
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True)
        self._shown = _Shown.of(self._setup)
        self._safety_stop = Reason("~safety_stop")
        self._state = StatePublisher(self._global.frame)
        self._shown_report = Report(Condition.STARTING)
        self._state.show(self._shown_report, rospy.get_time())
        self._recovery_status = rospy.Publisher("~recovery_status", RecoveryStatus, queue_size=1)
        self._clock = ClockWatch(simulated=not rospy.rostime.is_wallclock())
        self._last, self._heard, self._complete = -np.inf, False, False
        # Set by ``_offer``, once navigation has its inputs.
        self._goals: GoalServer
        self._odometry: Newest[Odometry]
        self._planner_service: rospy.Service
        self._reconfiguration: Reconfiguration

    def _serve_planner(self) -> rospy.Service:
        return rospy.Service(
            f"~{self._setup.global_planner_name}/make_plan", GetPlanArray, self._make_plan
        )

    def _adopt(self, setup: Setup) -> None:
        """Applies new parameters; keeps the costmaps' data and the current plan."""
        with self._turn:
            before, self._setup = self._setup, setup
            self._global.configure(setup.global_costmap)
            self._local.configure(setup.local_costmap)
            self._navigator.configure(setup)
            if setup.base.controller_frequency != before.base.controller_frequency:
                self._rate = rospy.Rate(setup.base.controller_frequency, reset=True)
            names = ("local_planner_name", "global_planner_name", "potential_scale")
            if any(getattr(setup, name) != getattr(before, name) for name in names):
                for publisher in self._shown:
                    if publisher:
                        publisher.unregister()
                self._shown = _Shown.of(setup)
            if setup.global_planner_name != before.global_planner_name:
                self._planner_service.shutdown("another planner")
                self._planner_service = self._serve_planner()

    def spin(self) -> None:
        """Waits for the inputs of navigation, then runs the loop until shutdown."""
        if not rospy.rostime.is_wallclock():
            threading.Thread(target=self._watch_clock, name="clock", daemon=True).start()
        while not rospy.is_shutdown() and not self._has_all(rospy.get_time()):
            self._rate.sleep()
        if rospy.is_shutdown():
            return
        self._offer()
        try:
            while not rospy.is_shutdown():
                self._turn_at(rospy.get_time())
                self._rate.sleep()
        finally:
            self.stop()

    def stop(self) -> None:
        """Commands zero; called last, also after an exception."""
        self._velocity.publish(Twist())

    def _watch_clock(self) -> None:
        """Stops the robot while simulated time stands still and reports why."""
        watch = StallWatch()
        while not (entry.wait(_CLOCK_PERIOD) or rospy.is_shutdown()):
            if watch.read(rospy.get_time(), time.monotonic()):
                with self._turn:
                    self._stand_without_clock(rospy.get_time())

    def _stand_without_clock(self, now: float) -> None:
        fault = f"/clock has stood still for more than {STALL:g} s"
        if not hasattr(self, "_goals"):
            self._show_start("simulated time on /clock", now)
        elif self._goals.active or self._goals.has_new:
            self.stop()
            self._safety_stop.publish(fault, now)
            self._show_meanwhile(Condition.BLOCKED, no_sensor_data(fault), now)

    def _show_start(self, missing: str, now: float) -> None:
        """Reports what the start waits for; empty if for nothing."""
        reason = (
            ReportedReason(Code.NO_SENSOR_DATA, f"waiting for {missing}") if missing else NO_REASON
        )
        self._show_meanwhile(Condition.STARTING, reason, now)

    def _show_meanwhile(self, condition: Condition, reason: ReportedReason, now: float) -> None:
        """Reports a state and a reason while the loop, which reports the navigator's, does not run."""
        before = self._shown_report
        if (condition, reason) != (before.condition, before.reason):
            self._shown_report = Report(condition, reason, now)
        self._state.show(self._shown_report, now)

    def step(self) -> None:
        """Runs one step in lockstep mode: a cycle, if it is due by ``controller_frequency``."""
        now = rospy.get_time()
        if 0.0 <= now - self._last < 1.0 / self._setup.base.controller_frequency - 1.0e-6:
            return
        self._complete = self._complete or self._has_all(now)
        if self._complete:
            self._turn_at(now)

    def ready(self) -> bool:
        """Returns whether maps and the robot's static transforms have arrived; goals are accepted from then on."""
        maps = self._global.has_map and self._local.has_map
        if not (maps and self._listener.has_fixed(self._global.base_frame)):
            return False
        if not hasattr(self, "_goals"):
            self._offer()
        return True

    def _offer(self) -> None:
        limit = self._setup.base.transform_future_limit
        self._goals = GoalServer(self._global.frame, self._listener, limit, self._goal_fault)
        self._odometry = Newest("odom", Odometry, 2)
        rospy.Service("~make_plan", GetPlanArray, self._make_plan_if_idle)
        rospy.Service("~clear_costmaps", Empty, self._clear_costmaps)
        self._planner_service = self._serve_planner()
        self._reconfiguration = Reconfiguration(self._parameters, self._setup, self._adopt)

    def _turn_at(self, now: float) -> None:
        with self._turn:
            before = self._clock.now
            jump = self._clock.read(now)
            if jump is Jump.RESET:
                self._restart(now)
            elif jump is Jump.STEP:
                self._forget_times(now, before - now)
            self._cycle(now)
            self._shown_report = self._navigator.report
            self._state.show(self._shown_report, now)
        if not self._heard and self._odometry.received is not None:
            self._heard = True
            rospy.loginfo("odom received!")
        self._last = now

    def _has_all(self, now: float) -> bool:
        """Updates the costmaps; returns whether both are complete, and logs missing inputs."""
        missing = self._global.missing(now) + self._local.missing(now)
        self._global.update(now)
        self._local.update(now)
        if missing:
            words = ", ".join(dict.fromkeys(missing))
            rospy.loginfo_throttle(_COMPLAIN_EVERY, f"waiting for {words}")
            self._show_start(words, now)
        return not missing and self._global.costmap.ready and self._local.costmap.ready

    def _restart(self, now: float) -> None:
        """Restarts after simulated time has started again; keeps the active goal."""
        rospy.logwarn("time jumped back: obstacles forgotten, the goal is planned again")
        for costmap in (self._global, self._local):
            costmap.forget()
        self._odometry.forget()
        self._goals.forget()
        self._carry_out(self._navigator.restart(self._global.pose(now), now), now)

    def _forget_times(self, now: float, back: float) -> None:
        """Continues after the clock was set back by ``back`` [s]: waits for new data, keeps the obstacles."""
        for costmap in (self._global, self._local):
            costmap.forget_times()
        self._odometry.forget()
        self._goals.forget()
        if back > RESET:  # the goal's patience would last as much longer
            rospy.logwarn("the clock was set back by %.1f s: the goal is planned again", back)
            self._carry_out(self._navigator.restart(self._global.pose(now), now), now)

    def _cycle(self, now: float) -> None:
        if self._rests():
            return
        if self._global.update(now):
            self._navigator.look_around(self._global.pose(now), now)
        if self._local.update(now) and (picture := self._local.picture(now)):
            self._navigator.look_at(picture)
        goal = self._goals.take()
        if goal is not None:
            self._carry_out(self._navigator.begin(goal, self._global.pose(now), now), now)
        if self._navigator.phase is Phase.IDLE:
            self._safety_stop.publish("", now)
        elif not self._goals.active or self._goals.cancelled():
            self._carry_out(self._navigator.cancel(now), now)
        else:
            self._drive_on(now)

    def _rests(self) -> bool:
        """Returns whether the costmaps are shut down: without a goal, if ``shutdown_costmaps`` asks for it."""
        without_goal = self._navigator.phase is Phase.IDLE and not self._goals.waiting
        return self._setup.base.shutdown_costmaps and without_goal

    def _drive_on(self, now: float) -> None:
        sight = self._sight(now)
        self._carry_out(self._navigator.cycle(sight, now), now)
        if sight.pose is not None and self._navigator.phase is not Phase.IDLE:
            self._goals.report(sight.pose, now)

    def _goal_fault(self, goal: Pose) -> str:
        return "" if self._setup.goal_tolerance else self._global.costmap.goal_fault(goal)

    def _sight(self, now: float) -> Sight:
        """Returns the robot's current state, as far as it is known; publishes why it may not drive."""
        pose, local_pose = self._global.pose(now), self._local.pose(now)
        robots = self._global.other_robots(now)
        try:
            velocity = self._measured_velocity(now)
            fault = self._global.fault(now) or self._local.fault(now)
            transform = self._listener.lookup(self._local.frame, self._global.frame).planar()
        except (TransformError, MessageError) as error:
            fault = str(error)
            self._blind.warn(fault)
        else:
            self._blind.end()
        self._safety_stop.publish(fault, now)
        if fault:
            return Sight(pose, fault=fault, robots=robots)
        return Sight(pose, local_pose, transform, velocity, current=True, robots=robots)

    def _measured_velocity(self, now: float) -> Velocity:
        """Returns the robot's velocity; raises MessageError without recent odometry."""
        odometry = next(self._odometry.arrivals(), None)
        timeout = self._setup.base.odom_timeout
        if odometry is None or (0.0 < timeout < now - odometry.received):
            raise MessageError(f"no odometry on {self._odometry.topic}: standing still")
        return velocity_from_odometry(odometry.message)

    def _refresh(self) -> None:
        """Updates the costmaps after a recovery behaviour has changed them, before the next planning."""
        now = rospy.get_time()
        self._global.update(now, forced=True)
        self._local.update(now, forced=True)

    def _carry_out(self, cycle: Cycle, now: float) -> None:
        """Publishes the results of a cycle."""
        if cycle.command is not None:
            self._drive(cycle.command)
        if cycle.found is not None:
            self._show_potential(cycle.found)
        if cycle.plan is not None:
            self._show(self._shown.plan, cycle.plan, self._global.frame, now)
        if cycle.decision is not None:
            self._show(self._shown.followed, cycle.decision.global_plan, self._local.frame, now)
            self._show(self._shown.driven, cycle.decision.local_plan, self._local.frame, now)
            if self._setup.publishes_cell_costs and self._shown.costs.get_num_connections():
                header = Header(0, rospy.Time.from_sec(now), self._local.frame)
                self._shown.costs.publish(cost_cloud(self._navigator.cell_costs(), header))
        for text in cycle.warnings:
            self._warn(text, now)
        if cycle.recovery is not None:
            self._report_recovery(cycle.recovery)
        if self._in_trouble and cycle.decision is not None and not cycle.warnings:
            self._in_trouble = False
            rospy.loginfo("following the plan again")
        if cycle.finish is not None:
            self._in_trouble = False
            self._goals.finish(cycle.finish.outcome, cycle.finish.text)

    def _warn(self, text: str, now: float) -> None:
        """Logs a warning; throttles each text separately."""
        if not 0.0 <= now - self._warned.get(text, -_COMPLAIN_EVERY) < _COMPLAIN_EVERY:
            self._warned = {
                old: time
                for old, time in self._warned.items()
                if 0.0 <= now - time < _COMPLAIN_EVERY
            }
            self._warned[text] = now
            self._in_trouble = True
            rospy.logwarn("%s", text)

    def _show_potential(self, search: Search) -> None:
        publisher, costmap = self._shown.potential, self._global.costmap
        if (
            publisher is None
            or not publisher.get_num_connections()
            or not isinstance(search, NavfnSearch)
        ):
            return
        if search.potential.shape == costmap.cells.shape:
            values = visible_potential(search.potential, self._setup.potential_scale)
            publisher.publish(self._global.grid_of(values, rospy.get_time()))

    def _show(self, publisher: rospy.Publisher, path: Path, frame: str, now: float) -> None:
        if publisher.get_num_connections():
            publisher.publish(PathMessage(path, frame, rospy.Time.from_sec(now)))

    def _drive(self, command: Velocity) -> None:
        message = Twist()
        message.linear.x, message.linear.y, message.angular.z = command.x, command.y, command.turn
        self._velocity.publish(message)

    def _report_recovery(self, started: StartRecovery) -> None:
        index, name, count = (
            started.index,
            self._setup.recoveries[started.index].name,
            len(self._setup.recoveries),
        )
        self._in_trouble = True
        rospy.logwarn("recovery behavior %d of %d: %s", index + 1, count, name)
        if self._recovery_status.get_num_connections():
            now = rospy.get_time()
            place = stamped_from_pose(
                self._local.pose(now) or Pose(), self._local.frame, rospy.Time.from_sec(now)
            )
            reason = f"{name} ({started.trigger.name.lower()})"
            self._recovery_status.publish(RecoveryStatus(place, index, count, reason))

    def _make_plan_if_idle(self, request: GetPlanRequest) -> GetPlanArrayResponse:
        if self._goals.active:
            raise rospy.ServiceException(_BUSY)
        with self._turn:
            pose = self._global.pose(rospy.get_time())
            if self._setup.base.make_plan_clear_costmap and pose is not None:
                costmap = self._global.costmap
                costmap.open_around(pose, 2.0 * costmap.footprint.circumscribed_radius)
        return self._make_plan(request, self._setup.base.make_plan_add_unreachable_goal)

    def _make_plan(self, request: GetPlanRequest, adds_goal: bool = False) -> GetPlanArrayResponse:
        """Plans for a service client; the plan is empty if the goal cannot be reached. The loop runs meanwhile.

        ``adds_goal`` appends the goal to a plan that ends beside it.
        """
        try:
            path = self._plan_for(request, adds_goal)
        except (NoPathError, GoalOutsideError) as error:
            rospy.logwarn("make_plan: %s", error)
            path = np.empty((0, 3))
        except (PlannerError, TransformError, MessageError) as error:
            raise rospy.ServiceException(str(error)) from error
        return GetPlanArrayResponse(PathMessage(path, self._global.frame, rospy.Time.now()))

    def _plan_for(self, request: GetPlanRequest, adds_goal: bool) -> Path:
        check_numbers("make_plan", request)
        start = (
            self._goals.in_global_frame(request.start) if request.start.header.frame_id else None
        )
        goal = self._goals.in_global_frame(request.goal)
        with self._turn:
            start = start or self._global.pose(rospy.get_time())
            if start is None:
                raise PlannerError(_NO_START)
            costmap = self._global.costmap
            place, resolution = costmap.geometry, costmap.geometry.resolution
            inside = nearest_inside(place, goal, request.tolerance)
            tolerance = request.tolerance - inside.distance(goal)
            search = self._navigator.planner.search(costmap, start, inside, tolerance)
        path = None
        while path is None:
            if rospy.is_shutdown():
                raise PlannerError("move_base is shutting down")
            path = search.advance(_CELLS_AT_ONCE)
        return with_goal(path, goal, resolution) if adds_goal else path

    def _clear_costmaps(self, _: EmptyRequest) -> EmptyResponse:
        with self._turn:
            now = rospy.get_time()
            for costmap in (self._global, self._local):
                costmap.costmap.reset()
                costmap.update(now, forced=True)
        return EmptyResponse()


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("move_base", MoveBaseNode)
