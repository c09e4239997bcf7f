"""Exception hierarchy of this package; each message is one line for the user."""

from pathlib import Path


class DemoError(Exception):
    """Base class of all errors that end a demo."""


class OptionError(DemoError):
    """A command line argument is invalid."""


class FolderInUseError(OptionError):
    """An output folder belongs to another running command."""

    def __init__(self, folder: Path, owner: str) -> None:
        self.folder = folder
        self.owner = f"process {owner}" if owner else "another command"
        super().__init__(
            f"{folder} is in use by {self.owner}: wait for its end, or give another folder"
        )


class VideoError(DemoError):
    """The video cannot be made."""


class NoWaypointError(DemoError):
    """The map has no room for the requested waypoints."""


class StartError(DemoError):
    """Start-up timed out; the message names the missing part."""


class FlipError(DemoError):
    """The gateway refused a rule that the observer needs."""


class StuckError(DemoError):
    """The fleet did not finish in time; the message names the robots and the likely reason."""


class FaultError(DemoError):
    """A fault of a scenario could not be injected."""
