"""The names of keys and channels in a hub's Redis."""

NAME_KEY = "rocon:hub:name"
PROTOCOL_KEY = "rocon:hub:protocol"
SALT_KEY = "rocon:hub:salt"
"""The salt; gateways derive the key of their links from it and the password."""
GATEWAYS_KEY = "rocon:gateways"
"""The set of all gateways' names, and the channel that announces joining and leaving."""
NAMESPACES_KEY = "rocon:namespaces"
"""The set of all robot namespaces announced by gateways since the hub was started."""
EXAMINE_KEY = "rocon:examine"
"""The channel for requesting an examination of all gateways' links; the message is the request id."""


def record_key(gateway: str) -> str:
    """Returns the key of a gateway's record, and the channel that announces its changes."""
    return f"rocon:gateway:{gateway}"


def alive_key(gateway: str) -> str:
    """Returns the key that exists while a gateway is alive; its value is the gateway's instance."""
    return f"rocon:alive:{gateway}"


def requests_key(gateway: str) -> str:
    """Returns the key of the requests to a gateway (hash: sender to request), and the channel for their changes."""
    return f"rocon:requests:{gateway}"


def lost_key(gateway: str) -> str:
    """Returns the key of the time at which a silent gateway was lost [s, the hub's clock]."""
    return f"rocon:lost:{gateway}"


def kept_key(gateway: str) -> str:
    """Returns the key of the text that a gateway stores on the hub for the next gateway of its name."""
    return f"rocon:kept:{gateway}"


def examined_key(request: str) -> str:
    """Returns the channel on which gateways answer the examination request with that id."""
    return f"rocon:examined:{request}"
