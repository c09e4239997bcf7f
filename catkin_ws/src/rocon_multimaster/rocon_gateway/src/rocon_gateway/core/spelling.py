"""Which names are spelt like one that does not exist."""

import difflib
import functools
import heapq

COUNT = 3
"""How many nearest names are reported."""

LIKE = 0.6
"""From this ratio of difflib on two names are spelt alike."""


class Spelling:
    """One name, and which others are spelt like it.

    To compare two names takes as long as to look up hundreds, and where there are a thousand gateways the next question
    is about nearly the same ones: only those that the last question was not about are compared.

    Args:
        name: to which others are compared.
    """

    def __init__(self, name: str) -> None:
        self._matcher = difflib.SequenceMatcher(b=name)
        self._known: frozenset[str] = frozenset()
        self._alike: dict[str, float] = {}

    def nearest(self, known: frozenset[str]) -> list[str]:
        """Returns those of `known` that are spelt most like the name, the nearest first; as `get_close_matches`."""
        self._alike = {one: ratio for one, ratio in self._alike.items() if one in known}
        for one in known - self._known:
            ratio = self._ratio(one)
            if ratio >= LIKE:
                self._alike[one] = ratio
        self._known = known
        return [one for _, one in heapq.nlargest(COUNT, ((ratio, one) for one, ratio in self._alike.items()))]

    def _ratio(self, other: str) -> float:
        """Returns how alike they are; of those that are not, an upper bound of it, which costs less."""
        self._matcher.set_seq1(other)
        ratio = 0.0
        for bound in (self._matcher.real_quick_ratio, self._matcher.quick_ratio, self._matcher.ratio):
            ratio = bound()
            if ratio < LIKE:
                break
        return ratio


@functools.lru_cache(maxsize=512)
def spelling_of(name: str, where: str) -> Spelling:
    """Returns the memory for a name that is missed somewhere; for one thread."""
    return Spelling(name)
