"""Decides when a relay batches small messages, like the interrupt moderation of a network card."""

REST = 0.0003
"""How long a relay rests while messages collect in its sockets [s]."""
STREAK = 8
"""Number of rounds in quick succession after which the relay begins to rest."""
SOON = 0.0006
"""Maximum time between two rounds of a streak [s]; longer than a rest, so that a flood counts as one streak."""
SMALL = 16 * 1024
"""A round with more bytes than this is efficient enough and ends the streak [bytes]."""


class Moderation:
    """Decides after each round of the loop whether to rest.

    A message that wakes a relay costs ten times as much as one that arrives together with others. So if small messages
    arrive more often than every `SOON`, they are batched, with a delay of up to `REST` per hop. All other traffic of
    the relay is then delayed as well. Without such a flood, or with large messages in between, nothing is delayed.
    """

    def __init__(self) -> None:
        self._last = -SOON
        self._streak = 0

    def rest(self, now: float, moved: int) -> float:
        """Returns how long to rest before the next round [s].

        Args:
            now: when the round ended, on any clock that does not jump [s].
            moved: bytes of messages moved in the round; a round with 0 is ignored.
        """
        if not moved:
            return 0.0
        self._streak = self._streak + 1 if moved <= SMALL and now - self._last < SOON else 0
        self._last = now
        return REST if self._streak >= STREAK else 0.0
