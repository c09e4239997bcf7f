"""Back-pressure: pauses a stream while its receivers are full, but does not wait for stalled receivers."""

import time
from collections.abc import Callable

from tcpros.fanout import Fanout, do_nothing
from tcpros.reactor import Reactor, Timer

STALL = 1.0
"""The receivers count as stalled if together they have taken no byte for this long [s]."""


class Brake:
    """Pauses a stream while the fan-out it feeds is full.

    If all receivers stall, the stream resumes and their backlogs drop the oldest messages until one of them takes
    data again: a stalled receiver must neither stop the sender nor make its own link look dead.

    Args:
        reactor: runs the periodic check.
        fanout: receives the stream.
        longest: upper limit for one pause, even if the receivers are slow rather than stalled [s].
        changed: called when the stream may resume.
    """

    def __init__(
        self, reactor: Reactor, fanout: Fanout, longest: float, changed: Callable[[], None]
    ) -> None:
        self.is_on = False  #: whether reading the stream is paused
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
        """Pauses the stream unless its receivers are stalled."""
        if self._stand_still and self._fanout.acknowledged() != self._acknowledged:
            self._yields = self._stand_still = False
        self.is_on = not self._yields
        self._since = time.monotonic()
        if self._timer is None:
            self._look_later()

    def cancel(self) -> None:
        """Stops the brake; no callback is called afterwards."""
        self._fanout.relieved = do_nothing
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
        """Checks the receivers every `STALL` seconds while on or yielding, with a single timer."""
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
