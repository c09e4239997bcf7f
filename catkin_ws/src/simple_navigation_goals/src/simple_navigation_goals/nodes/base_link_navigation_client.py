"""Drives a robot along waypoints given in its own frame, as it stands when it sets off for each."""

from nav_bundle.core.pose import Pose
from nav_bundle.core.transform import TransformError
from nav_bundle.nodes.transform import TransformListener, robot_frame
from pioneer_node.nodes.entry import run
from simple_navigation_goals.core.waypoint import Waypoint
from simple_navigation_goals.nodes.goal_client import GoalClientNode

_MAP = "map"


class RobotLocator:
    """Turns waypoints of a robot's frame into ones of ``map``, by where the robot stands at that moment.

    It listens to tf only while it has a waypoint to turn: tf carries the transforms of all robots.

    Args:
        frame: the robot's frame.
    """

    def __init__(self, frame: str) -> None:
        self._frame = frame
        self._listener: TransformListener | None = None

    def __call__(self, waypoint: Waypoint) -> Waypoint | None:
        """Returns ``waypoint`` in ``map``, None until tf has told where the robot is; other frames stay as they are."""
        if waypoint.frame != self._frame:
            return waypoint
        if self._listener is None:
            self._listener = TransformListener()
        try:
            robot = self._listener.lookup(_MAP, self._frame).planar()
        except TransformError:
            return None
        self._listener.close()
        self._listener = None
        pose = robot.compose(Pose(waypoint.x, waypoint.y, waypoint.yaw))
        return Waypoint(pose.x, pose.y, pose.yaw, _MAP, waypoint.wait)


def build() -> GoalClientNode:
    """Returns the node, for the robot whose ``tf_prefix`` is set in or above its namespace."""
    frame = robot_frame("base_link")
    return GoalClientNode("base_link_goal", frame, RobotLocator(frame))


def main() -> int:
    """Runs the node ``base_link_goal_client`` and returns its exit status."""
    return run("base_link_goal_client", build)
