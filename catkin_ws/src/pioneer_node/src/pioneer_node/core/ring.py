"""Names of lockstep rings, their members and topics (docs/lockstep.md)."""

from collections.abc import Mapping

MEMBERS = "LOCKSTEP_MEMBERS"
"""Environment variable that lists a robot's lockstep nodes: names in their namespace, in the order of their turns."""

INLET, OUTLET, PROBE = "period", "done", "probe"


def ring_topic(ring: str, name: str) -> str:
    """Returns a topic of a ring. The ring's name is its namespace, empty for the root."""
    return f"/{ring}/lockstep/{name}" if ring else f"/lockstep/{name}"


def membership(node: str, namespace: str, environ: Mapping[str, str]) -> tuple[str, list[str], str]:
    """Returns a node's ring, its members in order (empty if the node is not a member), and the node's name in it."""
    ring = namespace.strip("/")
    name = node.strip("/").removeprefix(ring).strip("/")
    members = environ.get(MEMBERS, "").split()
    return ring, members if name in members else [], name
