"""Which topics and services of a ROS master stop robots and cancel their goals."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

_COMMAND = "pioneer/cmd_vel"
_ACTION = "move_base"
_LIVE = frozenset({0, 1, 6, 7})  # pending, active, preempting, recalling (actionlib_msgs/GoalStatus)

Graph = Mapping[str, Collection[str]]
"""Maps topic or service names to the nodes behind them."""


@dataclass(frozen=True)
class Targets:
    """Topics and services through which robots are stopped."""

    commands: frozenset[str] = frozenset()  #: velocity topics of robots, ``…/pioneer/cmd_vel``
    actions: frozenset[str] = frozenset()  #: names of move_base actions that have a server, ``…/move_base``
    clears: frozenset[str] = frozenset()  #: services that clear a waypoint client's queue, ``…/clear``

    def of(self, robots: Collection[str]) -> "Targets":
        """Returns the targets in the namespaces ``robots``; all targets if ``robots`` is empty."""
        if not robots:
            return self
        spaces = tuple(f"/{robot.strip('/')}/" for robot in robots)
        parts = (self.commands, self.actions, self.clears)
        return Targets(*(frozenset(name for name in part if name.startswith(spaces)) for part in parts))


def targets_from_graph(publishers: Graph, subscribers: Graph, services: Graph, own: str = "") -> Targets:
    """Returns the stop targets found in a master's system state.

    A waypoint client is a node that offers ``~clear`` and publishes ``~queue``. Topics used only by node ``own``, the
    caller, are ignored.
    """
    return Targets(
        commands=frozenset(_ending(_others(publishers, own) | _others(subscribers, own), _COMMAND)),
        actions=frozenset(
            name.removesuffix("/cancel") for name in _ending(_others(subscribers, own), f"{_ACTION}/cancel")
        ),
        clears=frozenset(name for name in services if name.endswith("/clear") and _queue_of(name) in publishers),
    )


def _others(graph: Graph, own: str) -> set[str]:
    return {name for name, nodes in graph.items() if any(node != own for node in nodes)}


def _ending(names: Iterable[str], end: str) -> set[str]:
    return {name for name in names if name.endswith(f"/{end}")}


def _queue_of(service: str) -> str:
    return f"{service.removesuffix('/clear')}/queue"


def any_live(statuses: Iterable[int]) -> bool:
    """Returns whether any of the goal ``statuses`` (actionlib_msgs/GoalStatus) belongs to a goal that has not ended."""
    return any(status in _LIVE for status in statuses)
