"""The errors of this package: one tree, so that a caller can catch them all or one kind."""


class SimulatorError(Exception):
    """Root of every error that the simulator raises on purpose."""


class ModelError(SimulatorError):
    """A model that does not exist, or cannot be where it was asked to be."""


class BoundError(SimulatorError):
    """A number that the engine cannot simulate."""


class SpawnError(SimulatorError):
    """A model that could not be added to the running simulator."""


class DescriptionError(SimulatorError):
    """A world or robot file that cannot be used: the message names file, element and what is wrong."""
