"""The names of keys and channels in a hub's Redis."""

NAME_KEY = "rocon:hub:name"
PROTOCOL_KEY = "rocon:hub:protocol"
SALT_KEY = "rocon:hub:salt"
"""From which, and the password, gateways derive the key of their links."""
GATEWAYS_KEY = "rocon:gateways"
"""The set of all gateways' names, and the channel that announces joining and leaving."""
NAMESPACES_KEY = "rocon:namespaces"
"""The set of the namespaces of all robots that gateways told of since the hub was started."""
EXAMINE_KEY = "rocon:examine"
"""The channel on which all gateways are asked to look at their links; the message is a request's number."""


def record_key(gateway: str) -> str:
    """Returns the key of a gateway's record, and the channel that announces its changes."""
    return f"rocon:gateway:{gateway}"


def alive_key(gateway: str) -> str:
    """Returns the key that exists while a gateway lives; its value is the gateway's instance."""
    return f"rocon:alive:{gateway}"


def requests_key(gateway: str) -> str:
    """Returns the key of the requests to a gateway (hash: sender to request), and the channel that tells senders."""
    return f"rocon:requests:{gateway}"


def lost_key(gateway: str) -> str:
    """Returns the key that tells since when [s, the hub's clock] a gateway whose record is kept is not heard of."""
    return f"rocon:lost:{gateway}"


def kept_key(gateway: str) -> str:
    """Returns the key of what a gateway has the hub keep for the next one of its name."""
    return f"rocon:kept:{gateway}"


def examined_key(request: str) -> str:
    """Returns the channel on which gateways answer the request of that number."""
    return f"rocon:examined:{request}"
