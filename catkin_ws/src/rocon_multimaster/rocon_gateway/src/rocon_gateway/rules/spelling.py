"""Finds existing names similar to an unknown one, for "did you mean" hints."""

import difflib
import functools
import heapq

COUNT = 3
"""Number of similar names to report."""

LIKE = 0.6
"""Minimum difflib ratio of similar names."""


class Spelling:
    """Finds names similar to a given one, reusing earlier comparisons.

    Comparing two names takes as long as hundreds of dictionary look-ups, and with a thousand gateways successive
    queries are nearly the same. So only names that were not part of the previous query are compared.

    Args:
        name: the name to compare with.
    """

    def __init__(self, name: str) -> None:
        self._matcher = difflib.SequenceMatcher(b=name)
        self._known: frozenset[str] = frozenset()
        self._alike: dict[str, float] = {}

    def nearest(self, known: frozenset[str]) -> list[str]:
        """Returns the names in `known` most similar to the name, best first, like `difflib.get_close_matches`."""
        self._alike = {one: ratio for one, ratio in self._alike.items() if one in known}
        for one in known - self._known:
            ratio = self._ratio(one)
            if ratio >= LIKE:
                self._alike[one] = ratio
        self._known = _shared(known)
        return [
            one
            for _, one in heapq.nlargest(
                COUNT, ((ratio, one) for one, ratio in self._alike.items())
            )
        ]

    def _ratio(self, other: str) -> float:
        """Returns the similarity; for dissimilar names only an upper bound, which is cheaper."""
        self._matcher.set_seq1(other)
        ratio = 0.0
        for bound in (
            self._matcher.real_quick_ratio,
            self._matcher.quick_ratio,
            self._matcher.ratio,
        ):
            ratio = bound()
            if ratio < LIKE:
                break
        return ratio


@functools.lru_cache(maxsize=512)
def spelling_of(name: str, where: str) -> Spelling:
    """Returns the cached `Spelling` for an unknown name at a place; for one thread."""
    return Spelling(name)


@functools.lru_cache(maxsize=8)
def _shared(names: frozenset[str]) -> frozenset[str]:
    """Returns an equal set that others keep already, if there is one: each may hold a thousand names."""
    return names
