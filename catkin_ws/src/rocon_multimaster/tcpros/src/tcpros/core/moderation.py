"""When a relay lets small messages wait for one another, as a network card does (interrupt moderation)."""

REST = 0.0003
"""How long a relay rests, while what comes gathers in its sockets [s]."""
STREAK = 8
"""So many rounds must have come one soon after the other."""
SOON = 0.0006
"""What is soon [s]; longer than a rest, so that a flood counts as one streak."""
SMALL = 16 * 1024
"""More bytes than this in a round are worth their round [bytes]."""


class Moderation:
    """Decides it, round by round.

    A message that wakes a relay costs it ten times what one costs that comes together with others. So where small
    messages come faster than every `SOON`, they are delayed by up to `REST` each hop and taken together. While they
    come so, everything else that the relay carries waits as long; without them, or with large ones between, nothing
    does.
    """

    def __init__(self) -> None:
        self._last = -SOON
        self._streak = 0

    def rest(self, now: float, moved: int) -> float:
        """Returns how long to rest before the next round [s].

        Args:
            now: when the round ended, on any clock that does not jump [s].
            moved: bytes of messages that it took; 0 for a round that was about something else, which changes nothing.
        """
        if not moved:
            return 0.0
        self._streak = self._streak + 1 if moved <= SMALL and now - self._last < SOON else 0
        self._last = now
        return REST if self._streak >= STREAK else 0.0
