"""The names of rings of nodes in lockstep, and of their members (docs/lockstep.md)."""

from collections.abc import Mapping

MEMBERS = "LOCKSTEP_MEMBERS"
"""Environment variable of a robot's nodes in lockstep: names below their namespace, in the order of their turns."""

INLET, OUTLET, PROBE = "period", "done", "probe"


def ring_topic(ring: str, name: str) -> str:
    """Returns a topic of a ring, whose name is its namespace; empty for the root."""
    return f"/{ring}/lockstep/{name}" if ring else f"/lockstep/{name}"


def membership(node: str, namespace: str, environ: Mapping[str, str]) -> tuple[str, list[str], str]:
    """Returns a node's ring, the ring's members in their order, and its name among them; no members if it is none."""
    ring = namespace.strip("/")
    name = node.strip("/").removeprefix(ring).strip("/")
    members = environ.get(MEMBERS, "").split()
    return ring, members if name in members else [], name
