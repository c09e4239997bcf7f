"""An action: `action.py serve|idle|call NAME`. A goal of n has n steps of feedback; `call` prints what it receives."""

import sys
import threading

import actionlib
import rospy
from actionlib.msg import TestAction, TestActionFeedback, TestFeedback, TestGoal, TestResult
from actionlib_msgs.msg import GoalStatus

STEP = 0.02
"""Time for a step [s]."""


class Server:
    """Counts up to the goal unless it is preempted."""

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


class Goal:
    """A goal and its outcome.

    It uses ActionClient because SimpleActionClient drops what a server sends before `send_goal` has returned, which
    happens when the process waits for CPU time. Feedback is read from its topic because a client drops feedback that
    arrives after the result, and the order of messages on two topics is undefined.
    """

    def __init__(self, client: actionlib.ActionClient, steps: int) -> None:
        self.active, self.done, self.told_all = (
            threading.Event(),
            threading.Event(),
            threading.Event(),
        )
        self.feedback: list[int] = []
        self._steps = steps
        rospy.Subscriber(f"{client.ns}/feedback", TestActionFeedback, self._on_feedback)
        self.handle = client.send_goal(TestGoal(steps), self._on_transition)

    def _on_transition(self, goal: actionlib.ClientGoalHandle) -> None:
        if goal.get_comm_state() == actionlib.CommState.ACTIVE:
            self.active.set()
        if goal.get_comm_state() == actionlib.CommState.DONE:
            self.done.set()

    def _on_feedback(self, one: TestActionFeedback) -> None:
        self.feedback.append(one.feedback.feedback)
        if len(self.feedback) == self._steps:
            self.told_all.set()

    def end(self) -> str:
        """Waits for the goal to end; returns its final state, or "no end" on a timeout."""
        return (
            GoalStatus.to_string(self.handle.get_terminal_state())
            if self.done.wait(20)
            else "no end"
        )


def call(client: actionlib.ActionClient) -> None:
    """Runs one goal to its end, then cancels another once it is known to be active.

    It must not cancel earlier: if a status that was sent before the goal arrived comes after the cancel, an actionlib
    client considers its goal lost.
    """
    say(f"server {client.wait_for_server(rospy.Duration(20))}")
    goal = Goal(client, 5)
    goal.told_all.wait(20)
    say(f"{goal.end()} {goal.handle.get_result().result} {goal.feedback}")
    goal = Goal(client, 100000)
    say(f"active {goal.active.wait(20)}")
    goal.handle.cancel()
    say(goal.end())


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> None:
    what, name = rospy.myargv(sys.argv)[1:]
    rospy.init_node("action")
    if what == "serve":
        held: object = Server(name)
    else:
        held = actionlib.ActionClient(name, TestAction)
        if what == "call":
            call(held)
            return
    rospy.spin()
    del held


if __name__ == "__main__":
    main()
