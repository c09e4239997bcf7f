"""Drives a robot along waypoints given in ``map``."""

from pioneer_node.nodes.entry import run
from simple_navigation_goals.nodes.goal_client import GoalClientNode


def main() -> int:
    """Runs the node ``map_goal_client`` and returns its exit status."""
    return run("map_goal_client", lambda: GoalClientNode("map_goal", "map"))
