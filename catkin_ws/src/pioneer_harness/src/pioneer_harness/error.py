"""The errors of this package, one tree."""


class HarnessError(Exception):
    """Root of every error that the harness raises."""


class WaitError(HarnessError):
    """What was awaited did not come about in time; the message names it and the last value seen."""


class PortError(HarnessError):
    """No port of a range is free."""


class ProcessStartError(HarnessError):
    """A program could not be started: not found, not executable, or its log cannot be written."""


class ProcessDiedError(HarnessError):
    """A process ended that was to live; the message names it, how it ended, and its last lines of output."""
