"""The errors of this package: one class hierarchy, so that callers can catch all of them or one kind."""


class SimulatorError(Exception):
    """Base class of all errors raised by the simulator."""


class ModelError(SimulatorError):
    """A model does not exist, or cannot have the requested pose."""


class BoundError(SimulatorError):
    """A value is outside the range that the engine can simulate."""


class SpawnError(SimulatorError):
    """A model could not be spawned."""


class TopicError(SimulatorError):
    """A topic cannot be advertised: it has another type already."""


class DescriptionError(SimulatorError):
    """A world or robot file is invalid; the message gives file, element and reason."""
