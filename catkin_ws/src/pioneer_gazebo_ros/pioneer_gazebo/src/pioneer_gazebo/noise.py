"""Noise of sensors: a function of the seed, the sensor and the simulated time, and of nothing else.

So a reading is the same for any set of subscribers, however often it is read, and whatever was read before.
"""

import hashlib

import numpy as np


class Noise:
    """The noise of one sensor."""

    def __init__(self, seed: int, *names: str) -> None:
        """Takes the simulation's seed, and the names that tell the sensor from every other."""
        text = "\0".join((str(seed), *names))
        key = np.frombuffer(hashlib.blake2b(text.encode(), digest_size=16).digest(), np.uint64)
        self._bits = np.random.Philox(key=key)
        self._generator = np.random.Generator(self._bits)
        self._state = self._bits.state

    def at(self, tick: int) -> np.random.Generator:
        """Returns a generator at the beginning of the sequence of a tick; valid until the next call."""
        # The counter's first word counts within a tick.
        self._state["state"]["counter"][:] = (0, tick, 0, 0)
        self._bits.state = self._state
        return self._generator
