"""Goals of move_base: its action server, and the simple goal topic for clients without actionlib."""

import math
from collections.abc import Callable
from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal, MoveBaseFeedback, MoveBaseResult

from nav_bundle.base.conversions import pose_from_message, stamped_from_pose
from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.topics import TransformListener
from nav_bundle.base.transform import TransformError
from nav_bundle.costmap.node import costmap_frame
from nav_bundle.move_base.state_machine import Outcome
from pioneer_node.core.frame import stripped

_INVALID = "Aborting on goal because it was sent with an invalid quaternion"
_RECALLED = "All goals were cancelled while this one waited for a transform"
_WARNING_PERIOD = 5.0
_VERTICAL = 1.0e-3


class GoalError(NavigationError):
    """A goal that is invalid on any map; the message names the reason."""


def check_goal(pose: PoseMessage) -> None:
    """Raises if a goal has a NaN or infinite number, or a rotation that is not a pure yaw.

    Raises:
        GoalError: with move_base's message.
    """
    position, rotation = pose.position, pose.orientation
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    if not all(map(math.isfinite, (x, y, z, w))):
        raise GoalError("Quaternion has nans or infs... discarding as a navigation goal")
    if not all(map(math.isfinite, (position.x, position.y, position.z))):
        raise GoalError("Position has nans or infs... discarding as a navigation goal")
    squared = x * x + y * y + z * z + w * w
    if squared < 1.0e-6:
        raise GoalError("Quaternion has length close to zero... discarding as navigation goal")
    upright = (w * w - x * x - y * y + z * z) / squared
    if abs(upright - 1.0) > _VERTICAL:
        raise GoalError(
            "Quaternion is invalid... for navigation the z-axis of the quaternion must be close to vertical."
        )


class ActionServer(actionlib.SimpleActionServer):
    """An actionlib server that survives a clock that jumps back.

    actionlib's own server stops publishing its status, because its timer ends at the jump. It also rejects new goals
    as outdated until the clock passes the stamp of the last goal.

    Invalid messages have no side effects. A goal with a ``fault`` is aborted without preempting the active goal. A
    cancel stamped more than ``future_limit`` [s] ahead, which would block all goals until then, is dropped.

    ``fault`` may wait, for example for a transform. A cancel of all goals holds for the goal that waits, too
    (not for one that the same client has sent meanwhile, which rospy passes on only then).
    """

    def __init__(self, name: str, fault: Callable[[PoseStamped], str], future_limit: float) -> None:
        super().__init__(name, MoveBaseAction, auto_start=False)
        self._goal_fault, self._future_limit = fault, future_limit
        self._cancels_of_all = 0
        server = self.action_server
        self._pass_goal, self._pass_cancel = (
            server.internal_goal_callback,
            server.internal_cancel_callback,
        )
        server.internal_goal_callback, server.internal_cancel_callback = (
            self._on_goal,
            self._on_cancel,
        )

    def _on_goal(self, goal: MoveBaseActionGoal) -> None:
        cancels = self._cancels_of_all
        if fault := self._goal_fault(goal.goal.target_pose):
            self._refuse(goal, GoalStatus.ABORTED, fault)
            return
        # Otherwise, a cancel between the two lines would find no goal.
        with self.action_server.lock:
            if self._cancels_of_all == cancels:
                self._pass_goal(goal)
                return
        self._refuse(goal, GoalStatus.RECALLED, _RECALLED)

    def _refuse(self, goal: MoveBaseActionGoal, state: int, text: str) -> None:
        status = GoalStatus(goal.goal_id, state, text)
        self.action_server.publish_result(status, MoveBaseResult())

    def _on_cancel(self, cancel: GoalID) -> None:
        ahead = (cancel.stamp - rospy.Time.now()).to_sec()
        if ahead <= self._future_limit:
            with self.action_server.lock:
                if not cancel.id and cancel.stamp.is_zero():
                    self._cancels_of_all += 1
                self._pass_cancel(cancel)
        else:
            rospy.logwarn_throttle(
                _WARNING_PERIOD,
                f"a cancel was dropped: it is stamped {ahead:.1f} s ahead of the clock",
            )

    def start(self) -> None:
        """Starts the server with a status timer that survives a clock jump."""
        super().start()
        server = self.action_server
        if server.status_frequency > 0.0:
            server.status_timer.shutdown()
            period = rospy.Duration(1.0 / server.status_frequency)
            rospy.Timer(period, server.publish_status_async, reset=True)

    def internal_goal_callback(self, goal: Any) -> None:
        """Accepts a goal; clears the stamps of earlier goals that are in the future, which precede a clock jump."""
        with self.lock:
            for earlier in (self.current_goal, self.next_goal):
                if earlier.get_goal() and earlier.get_goal_id().stamp > rospy.Time.now():
                    earlier.get_goal_id().stamp = rospy.Time()
        super().internal_goal_callback(goal)

    def forget(self) -> None:
        """Resets the stamp of the last cancel after the clock jumped back."""
        with self.action_server.lock:
            self.action_server.last_cancel = rospy.Time()


class GoalServer:
    """The action server ``move_base``.

    Goals in any frame are transformed into the global frame when they are accepted.

    Subscribes: ``move_base_simple/goal`` (geometry_msgs/PoseStamped), the action's ``goal`` and ``cancel``.

    Publishes: ``~current_goal`` (geometry_msgs/PoseStamped), the action's ``feedback``, ``result`` and ``status``.

    Services: none.

    Parameters: none.

    Threads: actionlib's callbacks store goals; the owner's loop calls ``take`` and the other methods. There is no
        execute thread.

    On error: a goal with an invalid pose or without a transform is aborted with the reason, and the active goal
        continues. A goal that the map rules out preempts the active goal and is then aborted.
    """

    def __init__(
        self,
        global_frame: str,
        listener: TransformListener,
        future_limit: float,
        fault: Callable[[Pose], str],
    ) -> None:
        """Starts the server.

        Args:
            global_frame: frame that goals are transformed into.
            listener: provides the transforms.
            future_limit: how far ahead of the clock a cancel may be stamped [s].
            fault: returns why a goal in the global frame can never be reached; empty if it may be reachable.
        """
        self._frame, self._listener, self._fault = global_frame, listener, fault
        self._goal_publisher = rospy.Publisher("~current_goal", PoseStamped, queue_size=1)
        self._action_goal_publisher = rospy.Publisher(
            "move_base/goal", MoveBaseActionGoal, queue_size=1
        )
        self._server = ActionServer("move_base", self._message_fault, future_limit)
        self._server.start()
        rospy.Subscriber("move_base_simple/goal", PoseStamped, self._on_simple_goal, queue_size=1)

    def _on_simple_goal(self, goal: PoseStamped) -> None:
        action_goal = MoveBaseActionGoal()
        action_goal.header.stamp = rospy.Time.now()
        action_goal.goal.target_pose = goal
        self._action_goal_publisher.publish(action_goal)

    def forget(self) -> None:
        """Resets state from before a clock jump; keeps the active goal."""
        self._server.forget()

    @property
    def active(self) -> bool:
        """True while a goal is active."""
        return bool(self._server.is_active())

    @property
    def has_new(self) -> bool:
        """True while a goal waits to be accepted."""
        return bool(self._server.is_new_goal_available())

    @property
    def waiting(self) -> bool:
        """True while a goal waits to be taken."""
        return bool(self._server.is_new_goal_available())

    def take(self) -> Pose | None:
        """Accepts a new goal and returns it in the global frame; None if there is none or it was aborted."""
        if not self._server.is_new_goal_available():
            return None
        target = self._server.accept_new_goal().target_pose
        try:
            goal = self.in_global_frame(target, patience=0.0)
        except TransformError as error:  # the transform was available when the goal arrived
            rospy.logerr("%s", error)
            self._server.set_aborted(MoveBaseResult(), str(error))
            return None
        self._goal_publisher.publish(stamped_from_pose(goal, self._frame, rospy.Time.now()))
        if fault := self._fault(goal):
            rospy.logwarn("%s", fault)
            self._server.set_aborted(MoveBaseResult(), fault)
            return None
        return goal

    def _message_fault(self, target: PoseStamped) -> str:
        """Returns why a goal is invalid, and logs the reason; empty if it is valid."""
        try:
            check_goal(target.pose)
            self.in_global_frame(target)
        except NavigationError as error:
            rospy.logerr("%s", error)
            return _INVALID if isinstance(error, GoalError) else str(error)
        return ""

    def in_global_frame(self, pose: PoseStamped, patience: float = 1.0) -> Pose:
        """Returns a pose in the global frame, using the newest transform; an empty frame means the global frame.

        Args:
            pose: a pose in any frame.
            patience: how long to wait for the transform [s, wall time]; 0 in the loop, which must not wait.

        Raises:
            TransformError: there is no transform into the global frame.
        """
        frame = stripped(pose.header.frame_id) or self._frame
        if frame == self._frame:
            return pose_from_message(pose.pose)
        candidates = _candidates(pose.header.frame_id)
        try:
            transform = self._listener.wait_for_any(self._frame, candidates, None, patience)
        except TransformError as fault:
            raise TransformError(
                f"Failed to transform the goal pose from {frame} into the {self._frame} frame: {fault}"
            ) from fault
        return transform.planar().compose(pose_from_message(pose.pose))

    def cancelled(self) -> bool:
        """Returns whether the active goal was cancelled and no new goal has arrived."""
        return bool(
            self._server.is_preempt_requested() and not self._server.is_new_goal_available()
        )

    def report(self, pose: Pose, now: float) -> None:
        """Publishes the robot's pose as the goal's feedback."""
        stamped = stamped_from_pose(pose, self._frame, rospy.Time.from_sec(now))
        self._server.publish_feedback(MoveBaseFeedback(stamped))

    def finish(self, outcome: Outcome, text: str) -> None:
        """Ends the active goal with ``outcome``."""
        if not self._server.is_active():
            return
        ends = {
            Outcome.SUCCEEDED: self._server.set_succeeded,
            Outcome.ABORTED: self._server.set_aborted,
            Outcome.PREEMPTED: self._server.set_preempted,
        }
        ends[outcome](MoveBaseResult(), text)


def _candidates(frame: str) -> list[str]:
    """Returns the possible tf names of a goal's frame: a bare name is first tried under the robot's tf_prefix."""
    return [stripped(frame)] if "/" in frame else list(dict.fromkeys((costmap_frame(frame), frame)))
