"""The errors of the hub."""


class HubNodeError(Exception):
    """Base class: the hub cannot run; the text says why and what to do."""


class PortBusyError(HubNodeError):
    """The hub's port is in use."""


class RedisError(HubNodeError):
    """redis-server is missing, does not start, or dies repeatedly."""


class AnnouncementError(HubNodeError):
    """The hub cannot be announced by mDNS; it works nevertheless."""
