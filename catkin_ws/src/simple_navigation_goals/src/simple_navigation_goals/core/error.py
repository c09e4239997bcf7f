"""The errors of this package."""


class WaypointError(ValueError):
    """A waypoint that no robot can drive to: a number that is not finite, or an orientation that is none."""


class PatrolError(ValueError):
    """A patrol that cannot be read."""


class QueueFileError(ValueError):
    """The file of waypoints cannot be read or written, or holds something else."""
