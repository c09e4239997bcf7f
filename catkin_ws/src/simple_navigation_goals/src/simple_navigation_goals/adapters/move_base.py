"""The action ``move_base`` as this package uses it: one goal at a time, and whether a server is connected."""

from collections.abc import Callable
from functools import partial

from actionlib import ActionClient, CommState
from actionlib.action_client import ClientGoalHandle
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from pioneer_node.nodes.exchange import Exchange
from simple_navigation_goals.core.queue import Outcome

_OUTCOMES = {
    GoalStatus.SUCCEEDED: Outcome.REACHED,
    GoalStatus.ABORTED: Outcome.ABORTED,
    GoalStatus.REJECTED: Outcome.ABORTED,
    GoalStatus.PREEMPTED: Outcome.CANCELLED,
    GoalStatus.RECALLED: Outcome.CANCELLED,
    GoalStatus.LOST: Outcome.LOST,
}


class MoveBase:
    """A client of the move_base action.

    It stands on actionlib's ActionClient: SimpleActionClient drops what a server says before ``send_goal`` has
    returned, and a goal that is reached at once would never end.

    Args:
        name: of the action.
        on_done: called with (serial, outcome, text) when the goal that ``send`` numbered ``serial`` has ended; from
            a thread of rospy's.
    """

    def __init__(self, name: str, on_done: Callable[[int, Outcome, str], None]) -> None:
        self._name = name
        self._client = ActionClient(name, MoveBaseAction)
        self._on_done = on_done
        self._serial = 0
        self._goal: ClientGoalHandle | None = None

    def present(self) -> bool:
        """Tells whether a server is connected in both directions. Does not wait.

        actionlib's ``wait_for_server`` counts in ROS time, which stands still while a simulation is paused, and never
        notices that a server has ended.
        """
        action = self._client
        if action.last_status_msg is None or Exchange.current is not None:
            return action.last_status_msg is not None  # in lockstep it needs no connection
        server = action.last_status_msg._connection_header["callerid"]
        publishers = (action.pub_goal, action.pub_cancel)
        subscribers = (action.status_sub, action.result_sub)
        return all(publisher.impl.has_connection(server) for publisher in publishers) and all(
            any(link.callerid_pub == server and link.socket is not None for link in subscriber.impl.connections)
            for subscriber in subscribers
        )

    def send(self, goal: MoveBaseGoal) -> int:
        """Sends a goal, forgets the one before, and returns the new goal's serial number."""
        self._serial += 1
        self._goal = self._client.send_goal(goal, transition_cb=partial(self._on_transition, self._serial))
        return self._serial

    def cancel(self) -> None:
        """Cancels the goal sent last, and forgets it."""
        if self._goal is not None:
            self._goal.cancel()
        self._goal = None

    def renew(self) -> None:
        """Forgets the goal sent last and reconnects: its server has ended.

        rospy does not see that a subscriber is gone until it writes to it; a goal for the next server would be written
        to the last one's socket.
        """
        self._goal = None
        self._client.stop()
        self._client = ActionClient(self._name, MoveBaseAction)

    def _on_transition(self, serial: int, goal: ClientGoalHandle) -> None:
        if goal.get_comm_state() == CommState.DONE:
            self._on_done(serial, _OUTCOMES[goal.get_terminal_state()], goal.get_goal_status_text())
