"""Exception hierarchy of this package."""


class HarnessError(Exception):
    """Base class of all harness errors."""


class WaitError(HarnessError):
    """A wait timed out; the message names the condition and its last value."""


class PortError(HarnessError):
    """No port in the range is free."""


class ProcessStartError(HarnessError):
    """A program could not be started: not found, not executable, or its log cannot be written."""


class ProcessDiedError(HarnessError):
    """A process ended unexpectedly; the message gives its name, how it ended, and its last lines of output."""
