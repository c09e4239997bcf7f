"""Which topics and services of a ROS master stop robots and cancel their goals."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

_LIVE = frozenset(
    {0, 1, 6, 7}
)  # pending, active, preempting, recalling (actionlib_msgs/GoalStatus)

Graph = Mapping[str, Collection[str]]
"""Maps topic or service names to the nodes behind them."""


@dataclass(frozen=True)
class Targets:
    """Topics and services through which robots are stopped."""

    commands: frozenset[str] = frozenset()  #: velocity topics of robots, ``…/pioneer/cmd_vel``
    actions: frozenset[str] = (
        frozenset()
    )  #: names of move_base actions that have a server, ``…/move_base``
    clears: frozenset[str] = (
        frozenset()
    )  #: services that clear a waypoint client's queue, ``…/clear``

    def of(self, robots: Collection[str]) -> "Targets":
        """Returns the targets in the namespaces ``robots``; all targets if ``robots`` is empty."""
        if not robots:
            return self
        spaces = tuple(f"/{robot.strip('/')}/" for robot in robots)
        parts = (self.commands, self.actions, self.clears)
        return Targets(
            *(frozenset(name for name in part if name.startswith(spaces)) for part in parts)
        )


def targets_from_graph(
    publishers: Graph, subscribers: Graph, services: Graph, own: str = ""
) -> Targets:
    """Returns the stop targets found in a master's system state.

    A waypoint client is a node that offers ``~clear`` and publishes ``~queue``. Topics used only by node ``own``, the
    caller, are ignored.
    """

    def used(end: str, *graphs: Graph) -> list[str]:
        return [
            name
            for graph in graphs
            for name in graph
            if name.endswith(end) and {*graph[name]} - {own}
        ]

    clients = {name.removesuffix("/queue") for name in publishers if name.endswith("/queue")}
    return Targets(
        commands=frozenset(used("/pioneer/cmd_vel", publishers, subscribers)),
        actions=frozenset(
            name.removesuffix("/cancel") for name in used("/move_base/cancel", subscribers)
        ),
        clears=frozenset(f"{name}/clear" for name in clients if f"{name}/clear" in services),
    )


def any_live(statuses: Iterable[int]) -> bool:
    """Returns whether any of the goal ``statuses`` (actionlib_msgs/GoalStatus) belongs to a goal that has not ended."""
    return any(status in _LIVE for status in statuses)
