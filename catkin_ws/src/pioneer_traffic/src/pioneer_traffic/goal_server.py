"""The action ``traffic``: accepts goals in any frame that tf knows, and notices when a goal's client has ended."""

from collections import deque
from collections.abc import Callable

import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseFeedback, MoveBaseGoal, MoveBaseResult

from nav_bundle.base.conversions import pose_from_message, stamped_from_pose
from nav_bundle.base.error import NavigationError
from nav_bundle.base.topics import TransformListener
from nav_bundle.base.transform_store import FUTURE_LIMIT
from nav_bundle.move_base.action_server import ActionServer, check_goal
from pioneer_node.core.frame import stripped
from pioneer_node.nodes.rospy_handle import RospyHandle
from simple_navigation_goals.queue import Outcome

_TF_TIMEOUT = 1.0
"""Maximum wait for the transform of a goal into map [s of wall time]."""
_KEPT = 10
"""Number of goals whose senders are remembered until they are accepted."""


class GoalServer:
    """Serves the action ``traffic`` (move_base_msgs/MoveBaseAction).

    Subscribes: the action's ``goal`` and ``cancel``; ``traffic_simple/goal`` (geometry_msgs/PoseStamped).

    Publishes: the action's ``feedback``, ``result`` and ``status``.

    Threads: rospy's threads store goals and call ``on_goal``, ``on_preempt`` and ``on_cancel``; the owner's loop
        calls the methods.

    On error: a goal that is not a pose in a known frame is aborted with the reason, and the active goal continues.

    Args:
        handle: this node.
        listener: provides the transforms.
        on_goal: called when a goal has arrived.
        on_preempt: called when the active goal has been cancelled.
        on_cancel: called with each cancel request and the name of the node that sent it.
    """

    def __init__(
        self,
        handle: RospyHandle,
        listener: TransformListener,
        on_goal: Callable[[], object],
        on_preempt: Callable[[], object],
        on_cancel: Callable[[GoalID, str], object],
    ) -> None:
        self._handle = handle
        self._listener = listener
        self._senders: deque[tuple[MoveBaseGoal, str]] = deque(maxlen=_KEPT)
        self._client = ""  # node that sent the active goal; empty if its end does not matter
        # Before the server's own subscription, so that a goal's sender is known when the server gets the goal.
        self._goals = handle.subscribe("traffic/goal", MoveBaseActionGoal, self._note_sender)
        handle.subscribe("traffic/cancel", GoalID, on_cancel)
        self._server = ActionServer("traffic", self._fault, FUTURE_LIMIT)
        self._server.register_goal_callback(on_goal)
        self._server.register_preempt_callback(on_preempt)
        self._server.start()
        self._own_goals = rospy.Publisher("traffic/goal", MoveBaseActionGoal, queue_size=1)
        rospy.Subscriber("traffic_simple/goal", PoseStamped, self._on_simple_goal, queue_size=1)

    def forget(self) -> None:
        """Resets state from before a clock jump; keeps the active goal."""
        self._server.forget()

    def take(self) -> PoseStamped | None:
        """Accepts a new goal and returns it in map; None if there is none or it was aborted."""
        if not self._server.is_new_goal_available():
            return None
        goal = self._server.accept_new_goal()
        senders = (sender for sent, sender in self._senders if sent is goal)
        self._client = next(senders, "")
        try:
            return self._in_map(goal.target_pose, patience=0.0)
        except NavigationError as error:
            rospy.logerr("%s", error)
            self._server.set_aborted(MoveBaseResult(), str(error))
            return None

    def cancelled(self) -> str:
        """Returns why the active goal is to be cancelled; empty if it is not."""
        if not self._server.is_active() or self._server.is_new_goal_available():
            return ""
        if self._server.is_preempt_requested():
            return "the goal was cancelled"
        if self._client and self._handle.lockstep is None and not self._goals.hears(self._client):
            return f"{self._client}, which sent the goal, has ended"
        return ""

    def report(self, pose: PoseStamped) -> None:
        """Publishes the robot's pose as the active goal's feedback."""
        if self._server.is_active():
            self._server.publish_feedback(MoveBaseFeedback(pose))

    def finish(self, outcome: Outcome, text: str) -> None:
        """Ends the active goal."""
        ends = {
            Outcome.REACHED: self._server.set_succeeded,
            Outcome.ABORTED: self._server.set_aborted,
            Outcome.CANCELLED: self._server.set_preempted,
        }
        if self._server.is_active():
            ends[outcome](MoveBaseResult(), text)

    def _note_sender(self, message: MoveBaseActionGoal, sender: str) -> None:
        self._senders.append((message.goal, "" if sender == self._handle.name else sender))

    def _on_simple_goal(self, pose: PoseStamped) -> None:
        message = MoveBaseActionGoal()
        message.header.stamp = rospy.Time.now()
        message.goal.target_pose = pose
        self._own_goals.publish(message)

    def _fault(self, target: PoseStamped) -> str:
        """Returns why a goal cannot be accepted, and logs it; empty if it can."""
        try:
            check_goal(target.pose)
            self._in_map(target)
        except NavigationError as error:
            rospy.logerr("%s", error)
            return str(error)
        return ""

    def _in_map(self, target: PoseStamped, patience: float = _TF_TIMEOUT) -> PoseStamped:
        """Returns a pose in map; raises TransformError if tf does not know its frame.

        ``patience`` is how long to wait for the transform [s of wall time]; 0 in the loop, where it would delay stops.
        """
        frame = stripped(target.header.frame_id) or "map"
        if frame == "map":
            return target
        transform = self._listener.wait("map", frame, None, patience)
        pose = transform.planar().compose(pose_from_message(target.pose))
        return stamped_from_pose(pose, "map", target.header.stamp)
