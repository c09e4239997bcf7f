"""Drives a robot along waypoints in its own frame, relative to its pose when it starts towards each."""

from nav_bundle.base.pose import Pose
from nav_bundle.base.tf_message import RawTFMessage
from nav_bundle.base.transform import TransformError
from nav_bundle.base.transform_store import TransformStore
from pioneer_node.adapters.node_handle import NodeHandle, Subscriber
from pioneer_node.core.frame import prefixed
from pioneer_node.nodes.node_host import run
from simple_navigation_goals.goal_client import GoalClientNode
from simple_navigation_goals.waypoint import Waypoint

_MAP = "map"


class RobotLocator:
    """Transforms waypoints from a robot's frame to ``map``, by the robot's current pose.

    Subscribes to tf only while it has a waypoint to transform, since tf carries the transforms of all robots.

    Args:
        node: the node.
        frame: the robot's frame.
    """

    def __init__(self, node: NodeHandle, frame: str) -> None:
        self._node, self._frame = node, frame
        self._store: TransformStore | None = None
        self._subscribers: list[Subscriber] = []

    def __call__(self, waypoint: Waypoint) -> Waypoint | None:
        """Returns ``waypoint`` in ``map``, None until tf has the robot's pose; other frames stay unchanged."""
        if waypoint.frame != self._frame:
            return waypoint
        if self._store is None:
            self._store = self._listening()
        try:
            robot = self._store.lookup(_MAP, self._frame).planar()
        except TransformError:
            return None
        for subscriber in self._subscribers:
            subscriber.close()
        self._store = None
        pose = robot.compose(Pose(waypoint.x, waypoint.y, waypoint.yaw))
        return Waypoint(pose.x, pose.y, pose.yaw, _MAP, waypoint.wait)

    def _listening(self) -> TransformStore:
        store = TransformStore(self._node.now, lambda text: self._node.logger.warning("%s", text))
        self._subscribers = [
            self._node.subscribe("/tf", RawTFMessage, lambda one, _sender: store.take(one.buffer)),
            self._node.subscribe(
                "/tf_static", RawTFMessage, lambda one, _sender: store.take_static(one.buffer)
            ),
        ]
        return store


def build(node: NodeHandle) -> GoalClientNode:
    """Returns the node, for the robot whose ``tf_prefix`` is set in or above its namespace."""
    frame = prefixed(str(node.found_parameter("tf_prefix", "")), "base_link")
    return GoalClientNode(node, "base_link_goal", frame, RobotLocator(node, frame))


def main() -> int:
    """Runs the node ``base_link_goal_client`` and returns its exit status."""
    run("base_link_goal_client", build)
