"""What the hub raises."""


class HubNodeError(Exception):
    """The root: a hub that cannot run; the text says why and what to do."""


class PortBusyError(HubNodeError):
    """Somebody else listens on the hub's port."""


class RedisError(HubNodeError):
    """redis-server is missing, does not start, or dies again and again."""


class AnnouncementError(HubNodeError):
    """The hub cannot be announced; it can still be used."""
