"""Errors of the door to ROS 2."""


class DoorError(Exception):
    """Base class: bad input or a missing part; the message is one readable line."""


class RuleError(DoorError):
    """The rules' file does not say what crosses."""


class TypeUnknownError(DoorError):
    """A message type whose definition is not known on this side."""
