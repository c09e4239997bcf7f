"""A move_base without a robot: a goal's x decides its outcome.

x >= 100 is aborted, x < 0 stays active until it is cancelled, and any other goal is reached at once.
"""

import rospy
from actionlib import ActionServer
from move_base_msgs.msg import MoveBaseAction


class FakeMoveBase:
    """Serves the action ``move_base``; a new goal preempts the current one."""

    def __init__(self) -> None:
        self._current = None
        self._server = ActionServer(
            "move_base", MoveBaseAction, self._on_goal, self._on_cancel, auto_start=False
        )
        self._server.start()

    def _on_goal(self, goal) -> None:
        if self._current:
            self._current.set_canceled(text="another goal came")
        self._current = None
        goal.set_accepted()
        x = goal.get_goal().target_pose.pose.position.x
        if x >= 100.0:
            goal.set_aborted(text="too far")
        elif x >= 0.0:
            goal.set_succeeded(text="there")
        else:
            self._current = goal

    def _on_cancel(self, goal) -> None:
        if goal == self._current:
            self._current = None
            goal.set_canceled(text="as asked")


rospy.init_node("move_base")
fake = FakeMoveBase()
rospy.spin()
