"""An action: `action.py serve|idle|call NAME`. A goal of n has n steps of feedback; calling tells what comes."""

import sys
import threading

import actionlib
import rospy
from actionlib.msg import TestAction, TestFeedback, TestGoal, TestResult
from actionlib_msgs.msg import GoalStatus

STEP = 0.02
"""Time for a step [s]."""


class Server:
    """Counts up to the goal, unless it is told to stop."""

    def __init__(self, name: str) -> None:
        self._server = actionlib.SimpleActionServer(name, TestAction, self._count, auto_start=False)
        self._server.start()

    def _count(self, goal: TestGoal) -> None:
        for step in range(goal.goal):
            if self._server.is_preempt_requested():
                self._server.set_preempted(TestResult(step))
                return
            self._server.publish_feedback(TestFeedback(step))
            rospy.rostime.wallsleep(STEP)
        self._server.set_succeeded(TestResult(goal.goal))


def call(client: actionlib.SimpleActionClient) -> None:
    """A goal to its end, and one that is cancelled once it is known to be active.

    Not earlier: a status that was sent before the goal arrived, and came after the cancel, would make a client of
    actionlib's believe that its goal is lost.
    """
    feedback: list[int] = []
    active = threading.Event()
    say(f"server {client.wait_for_server(rospy.Duration(20))}")
    client.send_goal(TestGoal(5), feedback_cb=lambda one: feedback.append(one.feedback))
    client.wait_for_result(rospy.Duration(20))
    say(f"{GoalStatus.to_string(client.get_state())} {client.get_result().result} {feedback}")
    client.send_goal(TestGoal(100000), active_cb=active.set)
    active.wait(20)
    client.cancel_goal()
    ended = client.wait_for_result(rospy.Duration(20))
    say(f"{GoalStatus.to_string(client.get_state())} {ended}")


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> None:
    what, name = rospy.myargv(sys.argv)[1:]
    rospy.init_node("action")
    if what == "serve":
        held: object = Server(name)
    else:
        held = actionlib.SimpleActionClient(name, TestAction)
        if what == "call":
            call(held)
            return
    rospy.spin()
    del held


if __name__ == "__main__":
    main()
