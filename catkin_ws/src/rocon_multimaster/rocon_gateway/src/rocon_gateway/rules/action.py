"""Actions: recognises the five topics of an action at one node and treats them as one connection.

A node is the server of action `/fibonacci` if it subscribes to `/fibonacci/goal` and `cancel` and publishes
`status`, `feedback` and `result`; a client does the reverse. (https://wiki.ros.org/actionlib)
"""

from collections.abc import Collection, Iterator

from rocon_hub_protocol.rule import Connection, Kind
from rocon_relay.connection import ANY

ACTION_KINDS = frozenset({Kind.ACTION_CLIENT, Kind.ACTION_SERVER})

_FROM_CLIENT = (("goal", "ActionGoal"), ("cancel", "actionlib_msgs/GoalID"))
_FROM_SERVER = (
    ("status", "actionlib_msgs/GoalStatusArray"),
    ("feedback", "ActionFeedback"),
    ("result", "ActionResult"),
)
_GOAL = "/goal"
_GOAL_TYPE = "ActionGoal"


def actions(local: Collection[Connection]) -> frozenset[Connection]:
    """Returns the action servers and clients found among publishers and subscribers; type `*` if unknown."""
    known = {(one.kind, one.name, one.node): one for one in local}
    found = set()
    for goal in local:
        name = goal.name.removesuffix(_GOAL)
        if (
            not name
            or name == goal.name
            or not (goal.type == ANY or goal.type.endswith(_GOAL_TYPE))
        ):
            continue
        kind = Kind.ACTION_SERVER if goal.kind == Kind.SUBSCRIBER else Kind.ACTION_CLIENT
        action = Connection(kind, name, goal.type.removesuffix(_GOAL_TYPE), goal.node)
        if all((part.kind, part.name, part.node) in known for part in parts(action)):
            found.add(action)
    return frozenset(found)


def parts(connection: Connection) -> Iterator[Connection]:
    """Yields the publishers and subscribers of a connection: five for an action, otherwise the connection itself."""
    if connection.kind not in ACTION_KINDS:
        yield connection
        return
    is_client = connection.kind == Kind.ACTION_CLIENT
    for rows, published in ((_FROM_CLIENT, is_client), (_FROM_SERVER, not is_client)):
        for suffix, type_ in rows:
            kind = Kind.PUBLISHER if published else Kind.SUBSCRIBER
            full = (
                type_
                if "/" in type_
                else ANY
                if connection.type == ANY
                else connection.type + type_
            )
            yield Connection(kind, f"{connection.name}/{suffix}", full, connection.node)


def status_topic(topic: str) -> str:
    """Returns the status topic of the action whose client publishes `topic`; "" if `topic` is not part of an action.

    A client considers its server connected once the node that publishes the status also subscribes to its goals.
    """
    name, _, suffix = topic.rpartition("/")
    return f"{name}/status" if name and suffix in ("goal", "cancel") else ""
