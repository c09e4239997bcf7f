"""The root of this package's error tree."""


class NavigationError(Exception):
    """What went wrong in navigation, said in one line for people."""


class MapError(NavigationError):
    """A map that cannot be read, written or used."""


class ObservationError(NavigationError):
    """A sensor's message that cannot be read."""
