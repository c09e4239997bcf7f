"""The errors of this package."""


class WaypointError(ValueError):
    """An invalid waypoint: a number that is not finite, a negative wait, or an invalid orientation."""


class PatrolError(ValueError):
    """A patrol that cannot be read."""


class QueueFileError(ValueError):
    """The queue file cannot be read or written, or its content is invalid."""
