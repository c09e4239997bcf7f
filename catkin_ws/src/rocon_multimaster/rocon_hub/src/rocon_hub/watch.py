"""Tracks which gateways have just fallen silent, and which have been silent for too long."""

from collections.abc import Collection


class Watch:
    """Compares the registered gateways with those that send heartbeats. Times are monotonic [s].

    Args:
        patience: how long the record of a silent gateway is kept.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._silent: dict[str, float] = {}

    def fallen_silent(self, registered: Collection[str], alive: Collection[str]) -> set[str]:
        """Returns the registered gateways that are not alive and whose silence has not been noted yet."""
        silent = set(registered) - set(alive)
        self._silent = {name: since for name, since in self._silent.items() if name in silent}
        return silent - set(self._silent)

    def returned(self, alive: Collection[str]) -> set[str]:
        """Returns the gateways whose silence was noted and that are alive again."""
        return set(self._silent) & set(alive)

    def note(self, name: str, now: float) -> None:
        """Notes a gateway whose silence has been announced."""
        self._silent[name] = now

    def gone(self, now: float) -> set[str]:
        """Returns the gateways that have been silent for too long."""
        return {name for name, since in self._silent.items() if now - since >= self._patience}
