"""Velocity commands: queued by any thread, taken by the one that owns the simulation."""

from collections import deque
from typing import Generic, NamedTuple, TypeVar

Motion = TypeVar("Motion")

COMMANDS_KEPT = 100
"""The newest command counts, so only a few are kept."""


class Moment(NamedTuple):
    """A simulated time, as a thread reads it that does not own the clock."""

    epoch: int  #: how often time has restarted
    tick: int  #: since the last restart


class CommandQueue(Generic[Motion]):
    """Commands in the order of their arrival. `put` is thread-safe.

    The clock may restart between the moment that a thread reads and its call of `put`. A command of an earlier epoch is
    therefore dropped: its tick says nothing about the time that runs now.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[Moment, Motion]] = deque(maxlen=COMMANDS_KEPT)

    def put(self, moment: Moment, motion: Motion) -> None:
        """Queues a command that arrived at ``moment``."""
        self._waiting.append((moment, motion))

    def take(self, now: Moment) -> list[Motion]:
        """Removes and returns the commands that arrived by ``now``, the oldest first."""
        due = []
        while self._waiting:
            arrived, motion = self._waiting[0]
            if arrived.epoch == now.epoch and arrived.tick > now.tick:
                break
            self._waiting.popleft()
            if arrived.epoch == now.epoch:
                due.append(motion)
        return due

    def clear(self) -> None:
        """Drops all commands."""
        self._waiting.clear()
