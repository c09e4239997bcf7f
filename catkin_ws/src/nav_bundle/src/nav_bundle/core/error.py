"""The root of this package's error tree."""


class NavigationError(Exception):
    """What went wrong in navigation, said in one line for people."""


class MapError(NavigationError):
    """A map that cannot be read, written or used."""


class MessageError(NavigationError):
    """A message with a field that cannot be used."""


class ObservationError(MessageError):
    """A sensor's message that cannot be read."""
