"""The errors of this package, one tree; each message is one line for the user."""


class DemoError(Exception):
    """Root of every error that ends a demo."""


class OptionError(DemoError):
    """A command line argument that cannot be used."""


class VideoError(DemoError):
    """A film that cannot be made."""


class NoWaypointError(DemoError):
    """The map has no room for the waypoints that were asked for."""


class StartError(DemoError):
    """A part did not come up in time; the message names what was awaited."""


class FlipError(DemoError):
    """The gateway refused a rule that the observer needs."""


class StuckError(DemoError):
    """The fleet did not finish in time; the message says which robots, and what is known of the reason."""


class FaultError(DemoError):
    """A fault of a scenario that could not be brought about."""
