"""Counts collisions as contact episodes, not contact points."""

GAP = 0.5
"""A new episode begins after this simulated time [s] without contact."""


class CollisionCounter:
    """Counts the contact episodes of one body."""

    def __init__(self) -> None:
        self.count = 0
        self._last: float | None = None

    def touched(self, time: float) -> bool:
        """Records a contact at ``time`` [s]; returns whether it began a new episode."""
        new = self._last is None or time - self._last >= GAP
        self._last = time
        self.count += new
        return new
