"""Drives a robot along waypoints in the ``map`` frame."""

from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.nodes.node_host import run
from simple_navigation_goals.goal_client import GoalClientNode


def build(node: NodeHandle) -> GoalClientNode:
    """Returns the node."""
    return GoalClientNode(node, "map_goal", "map")


def main() -> int:
    """Runs the node ``map_goal_client`` and returns its exit status."""
    run("map_goal_client", build)
