"""Limits the rate at which clients that may only look use the server, so that commands are executed at once."""

import asyncio
import time

RATE, BURST = 100.0, 60.0
"""Requests and frames of all viewers together: maximum rate [1/s], and number that may arrive at once."""
FREE = 1 << 14
"""A frame counts once more for each of these [bytes]: handling it takes as much longer."""


class Pace:
    """A token bucket; those who find it empty wait. For one event loop."""

    def __init__(self, rate: float = RATE, burst: float = BURST) -> None:
        self._rate = rate
        self._ahead = burst / rate
        self._free_at = 0.0

    async def turn(self, size: int = 0) -> None:
        """Waits until one more request, or frame of this size [bytes], may be handled."""
        now = time.monotonic()
        cost = 1 + size / FREE
        self._free_at = max(self._free_at, now - self._ahead) + cost / self._rate
        if self._free_at > now:
            await asyncio.sleep(self._free_at - now)
