"""Decides when to poll our ROS master: on its notification if it supports that, otherwise periodically."""

import http.client
import time

from rocon_gateway.master.line import MasterError, MasterLine, request, value
from tcpros.descriptor import readable

LOOK_PERIOD = 0.15
"""Poll period for a master without notifications [s]; with notifications, the minimum average period."""

TOLD_PERIOD = 3.0
"""Poll period for a master with notifications that has sent none [s], in case it hangs."""

LOOKS_AT_ONCE = 5
"""Polls allowed in quick succession: a starting node makes several registrations within some hundredths of a second."""

_AWAITED = 5.0
"""How long the master shall wait for a registration before it answers anyway [s]."""


class Ration:
    """Rate limiter: allows one event per period on average, and short bursts.

    Args:
        period: average period [s].
        at_once: size of a burst.
    """

    def __init__(self, period: float, at_once: int) -> None:
        self._period, self._most = period, float(at_once)
        self._left, self._counted = self._most, float("-inf")

    def take(self, now: float) -> float:
        """Takes one event and returns how long to delay it [s]; ``now`` [s] must be monotonic."""
        left = min(self._most, self._left + (now - self._counted) / self._period)
        # Another event may cut a pause short; the rest of it must not delay the next event.
        self._left, self._counted = max(-1.0, left - 1.0), now
        return max(0.0, -self._left * self._period)


class MasterBell:
    """Waits until the next poll of a master is due. For one thread only.

    A master started by our own launcher offers the call ``awaitRegistrations`` (`pioneer_launch.patch`), which
    returns when a node has registered. Any other master returns an error and is not asked again.

    Args:
        uri: URI of the master.
        node: our own node's name.
    """

    def __init__(self, uri: str, node: str) -> None:
        self._line, self._node = MasterLine(uri), node
        self._count = 0
        self._tells: bool | None = None
        """Whether the master supports notifications; None until it has answered on this connection."""
        self._is_asked = False
        self.is_due = True  #: whether a poll was due when the last wait ended
        self._looked = float("-inf")
        self._ration = Ration(LOOK_PERIOD, LOOKS_AT_ONCE)

    def wait(self, reader: int, limit: float = TOLD_PERIOD) -> bool:
        """Waits up to ``limit`` [s] until a poll is due or ``reader`` is readable; returns whether it is readable."""
        self._ask()
        period = min(max(limit, 0.0), TOLD_PERIOD) if self._tells else LOOK_PERIOD
        ready = readable([reader, *self._line.descriptors], period)
        if ready and reader not in ready:
            pause = self._ration.take(time.monotonic()) if self._has_told() else LOOK_PERIOD
            ready |= readable([reader], pause)
        self.is_due = (
            bool(ready) or not self._tells or time.monotonic() >= self._looked + TOLD_PERIOD
        )
        if self.is_due:
            self._looked = time.monotonic()
        return reader in ready

    def look_again(self) -> None:
        """Makes a poll due at the end of the next wait, whatever ends it."""
        self._looked = float("-inf")

    def close(self) -> None:
        """Closes the connection; the next wait opens a new one."""
        self._line.close()
        self._is_asked, self._tells = False, None

    def _ask(self) -> None:
        if self._is_asked or self._tells is False:
            return
        try:
            self._line.send(request("awaitRegistrations", self._node, self._count, _AWAITED))
            self._is_asked = True
        except OSError:  # the poll will report that the master is down
            self.close()

    def _has_told(self) -> bool:
        """Reads the master's answer; returns whether it is a notification."""
        try:
            answer = self._line.read()
        except (
            MasterError,
            http.client.HTTPException,
            OSError,
        ):  # the master has ended or closed the connection
            self.close()
            return False
        self._is_asked = False
        try:
            self._count, self._tells = int(value(answer)), True
        except (MasterError, TypeError, ValueError):
            self._tells = False
        return self._tells
