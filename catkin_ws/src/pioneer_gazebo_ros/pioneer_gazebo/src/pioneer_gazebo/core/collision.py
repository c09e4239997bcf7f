"""Counting collisions: episodes of touching, not contact points."""

GAP = 0.5
"""A new episode begins after so much simulated time [s] without contact."""


class CollisionCounter:
    """Counts one body's episodes of contact."""

    def __init__(self) -> None:
        self.count = 0
        self._last: float | None = None

    def touched(self, time: float) -> bool:
        """Notes a contact at ``time`` [s]; returns whether it began a new episode."""
        new = self._last is None or time - self._last >= GAP
        self._last = time
        self.count += new
        return new
