"""Base classes of this package's errors."""


class NavigationError(Exception):
    """Base class of navigation errors; the message is one readable line."""


class MapError(NavigationError):
    """A map that cannot be read, written or used."""


class MessageError(NavigationError):
    """A message with a field that cannot be used."""


class ObservationError(MessageError):
    """A sensor's message that cannot be read."""
