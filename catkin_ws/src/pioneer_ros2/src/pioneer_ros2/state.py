"""States of the door's topics, and which of their changes belong into the log."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple


class State(NamedTuple):
    """What a topic, or the door itself, does now."""

    name: str  #: what it is about, such as ``/p1/odom to ROS 2``
    text: str  #: the state and, if something does not work, the reason
    is_ok: bool = True
    values: tuple[tuple[str, str], ...] = ()  #: counters, which change without a change of state


class StateLog:
    """Remembers the states, and tells which changes a reader of the log wants to know."""

    def __init__(self) -> None:
        self._known: dict[str, State] = {}

    def changes(self, states: Iterable[State]) -> list[State]:
        """Takes up all current states; returns those that newly fail, fail for another reason or work again."""
        current = {state.name: state for state in states}
        found = [state for state in current.values() if self._is_news(state)]
        self._known = current
        return found

    def _is_news(self, state: State) -> bool:
        before = self._known.get(state.name)
        failed = before is not None and not before.is_ok
        if state.is_ok:
            return failed
        return not failed or (before is not None and before.text != state.text)

    @property
    def known(self) -> Mapping[str, State]:
        """The states that were taken up last, by name."""
        return self._known
