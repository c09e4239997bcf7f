"""Regular expressions, each compiled once."""

import functools
import re


@functools.lru_cache(maxsize=4096)
def compiled(pattern: str) -> re.Pattern[str]:
    """Returns a pattern, compiled once. Raises re.error, RecursionError or OverflowError for what is none."""
    return re.compile(pattern)


def matches_whole(pattern: str, text: str) -> bool:
    """Tells whether the whole of `text` matches; `pattern` must be a regular expression."""
    return compiled(pattern).fullmatch(text) is not None
