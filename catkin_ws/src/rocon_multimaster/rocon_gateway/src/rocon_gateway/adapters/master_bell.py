"""When to look at our ROS master: as soon as something was registered where it tells that, else again and again."""

import http.client
import time

from rocon_gateway.adapters.master_line import MasterError, MasterLine, request, value
from tcpros.adapters.descriptor import readable

LOOK_PERIOD = 0.15
"""Time between two looks at a master that tells nothing [s]; with one that does, the mean of it over many."""

TOLD_PERIOD = 3.0
"""Time between two looks at a master that tells, and has told nothing [s]: for one that hangs."""

LOOKS_AT_ONCE = 5
"""So many looks may follow one another: a node that starts registers several things in some hundredths of a second."""

_AWAITED = 5.0
"""For how long the master is to wait for a registration before it answers all the same [s]."""


class Ration:
    """Says how long to wait with something that may happen once a period in the long run, and a few times at once.

    Args:
        period: [s].
        at_once: how many times.
    """

    def __init__(self, period: float, at_once: int) -> None:
        self._period, self._most = period, float(at_once)
        self._left, self._counted = self._most, float("-inf")

    def take(self, now: float) -> float:
        """Takes one, and returns the time to wait with it [s]; ``now`` [s] never goes back."""
        left = min(self._most, self._left + (now - self._counted) / self._period)
        # A pause may be ended early by something else; its time is not to be waited for with the next one.
        self._left, self._counted = max(-1.0, left - 1.0), now
        return max(0.0, -self._left * self._period)


class MasterBell:
    """Waits for the next look at a master. One thread only.

    A master of our own launcher has the call ``awaitRegistrations`` (`pioneer_node.nodes.patch`), which a thread of it
    answers when somebody has registered. Any other says that it knows no such call, and is not asked again.

    Args:
        uri: the master's.
        node: our own node's name.
    """

    def __init__(self, uri: str, node: str) -> None:
        self._line, self._node = MasterLine(uri), node
        self._count = 0
        self._tells: bool | None = None
        """None as long as the master has not answered on this connection."""
        self._is_asked = False
        self.is_due = True  #: whether the last wait ended because a look is due
        self._looked = float("-inf")
        self._ration = Ration(LOOK_PERIOD, LOOKS_AT_ONCE)

    def wait(self, reader: int, limit: float = TOLD_PERIOD) -> bool:
        """Waits until a look is due or ``reader`` can be read, at most ``limit`` [s]; returns whether it can."""
        self._ask()
        period = min(max(limit, 0.0), TOLD_PERIOD) if self._tells else LOOK_PERIOD
        ready = readable([reader, *self._line.descriptors], period)
        if ready and reader not in ready:
            pause = self._ration.take(time.monotonic()) if self._has_told() else LOOK_PERIOD
            ready |= readable([reader], pause)
        self.is_due = bool(ready) or not self._tells or time.monotonic() >= self._looked + TOLD_PERIOD
        if self.is_due:
            self._looked = time.monotonic()
        return reader in ready

    def look_again(self) -> None:
        """Has the next wait, whatever ends it, call for a look."""
        self._looked = float("-inf")

    def close(self) -> None:
        """Closes the connection; the next wait makes a new one."""
        self._line.close()
        self._is_asked, self._tells = False, None

    def _ask(self) -> None:
        if self._is_asked or self._tells is False:
            return
        try:
            self._line.send(request("awaitRegistrations", self._node, self._count, _AWAITED))
            self._is_asked = True
        except OSError:  # the look tells that the master is gone
            self.close()

    def _has_told(self) -> bool:
        """Reads what the master says."""
        try:
            answer = self._line.read()
        except (MasterError, http.client.HTTPException, OSError):  # it has ended, or closed the connection
            self.close()
            return False
        self._is_asked = False
        try:
            self._count, self._tells = int(value(answer)), True
        except (MasterError, TypeError, ValueError):
            self._tells = False
        return self._tells
