"""Which gateways have just fallen silent, and which have been silent for too long."""

from collections.abc import Collection


class Watch:
    """Compares who is registered with who gives signs of life. Times are monotonic [s].

    Args:
        patience: how long the record of a silent gateway is kept.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._silent: dict[str, float] = {}

    def fallen_silent(self, registered: Collection[str], alive: Collection[str]) -> set[str]:
        """Returns those who are registered, not alive, and were not noted since they last lived."""
        silent = set(registered) - set(alive)
        self._silent = {name: since for name, since in self._silent.items() if name in silent}
        return silent - set(self._silent)

    def returned(self, alive: Collection[str]) -> set[str]:
        """Returns those whose silence was noted and who live again."""
        return set(self._silent) & set(alive)

    def note(self, name: str, now: float) -> None:
        """Takes note of a gateway whose silence was announced."""
        self._silent[name] = now

    def gone(self, now: float) -> set[str]:
        """Returns those whose time is over."""
        return {name for name, since in self._silent.items() if now - since >= self._patience}
