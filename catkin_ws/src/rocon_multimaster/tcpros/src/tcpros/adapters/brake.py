"""Keeps a stream from bringing more than anybody takes, but waits for nobody who stands still."""

import time
from collections.abc import Callable

from tcpros.adapters.reactor import Reactor, Timer
from tcpros.core.fanout import Fanout

STALL = 1.0
"""Receivers that together have taken not a byte for so long are not waited for [s]."""


class Brake:
    """Holds a stream back while what it feeds is full.

    Where all receivers stand still, the stream resumes, and their backlogs drop the oldest, until one of them takes
    something again: a receiver that has stopped must not stop the sender, nor make its own link look dead.

    Args:
        reactor: where it looks after itself.
        fanout: what the stream feeds.
        longest: receivers that take something, but not all of what waits within so long, are not waited for either [s].
        changed: called when the stream may resume.
    """

    def __init__(self, reactor: Reactor, fanout: Fanout, longest: float, changed: Callable[[], None]) -> None:
        self.is_on = False  #: whether the stream shall not be read now
        self._reactor = reactor
        self._fanout = fanout
        self._longest = longest
        self._changed = changed
        self._since = 0.0
        self._timer: Timer | None = None
        self._acknowledged = -1
        self._yields = False
        self._stand_still = False
        fanout.relieved = self._release

    def apply(self) -> None:
        """Holds the stream back, unless its receivers stand still."""
        if self._stand_still and self._fanout.acknowledged() != self._acknowledged:
            self._yields = self._stand_still = False
        self.is_on = not self._yields
        self._since = time.monotonic()
        if self._timer is None:
            self._look_later()

    def cancel(self) -> None:
        """Ends; nothing is called any more."""
        self._fanout.relieved = _nothing
        if self._timer is not None:
            self._timer.cancel()

    def _release(self) -> None:
        self._yields = self._stand_still = False
        if self.is_on:
            self.is_on = False
            self._changed()

    def _look_later(self) -> None:
        self._timer = self._reactor.call_later(STALL, self._look)

    def _look(self) -> None:
        """Every `STALL` seconds while it holds or yields: one timer, however often the brake changes."""
        self._timer = None
        if not self.is_on and not self._yields:
            self._acknowledged = -1
            return
        acknowledged = self._fanout.acknowledged()
        stand_still, self._acknowledged = acknowledged == self._acknowledged, acknowledged
        yields = stand_still or (self.is_on and time.monotonic() - self._since >= self._longest)
        if yields:
            self._release()
        self._yields, self._stand_still = yields, stand_still
        self._look_later()


def _nothing() -> None:
    """Stands where nobody waits for relief."""
