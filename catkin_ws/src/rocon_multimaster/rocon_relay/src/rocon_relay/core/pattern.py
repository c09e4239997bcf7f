r"""Regular expressions in RE2's syntax, which match in time linear in the text; each is compiled once.

Python's own engine goes back and tries again: `/(\w+/?)+/odom` takes it minutes to say no to one long name. RE2 does
without look-ahead, look-behind, back-references, possessive quantifiers and atomic groups, all of which it refuses.
"""

import functools

import re2

from rocon_relay.core.error import RelayError

LONGEST_PATTERN = 1024
"""Longest pattern [characters]."""

_OPTIONS = re2.Options()
_OPTIONS.log_errors = False
_OPTIONS.max_mem = 1 << 20


class PatternError(RelayError):
    """A text that is no regular expression, or one that cannot be matched in linear time."""


@functools.lru_cache(maxsize=4096)
def compiled(pattern: str) -> "re2._Regexp[str]":
    """Returns a pattern, compiled once. Raises PatternError for a text that is none."""
    if len(pattern) > LONGEST_PATTERN:
        raise PatternError(f"it has {len(pattern)} characters, more than {LONGEST_PATTERN}")
    try:
        return re2.compile(pattern, _OPTIONS)
    except (re2.error, UnicodeEncodeError) as error:
        reason = error.args[0] if isinstance(error, re2.error) else b"it is not valid UTF-8"
        text = reason.decode(errors="replace")
        raise PatternError(f"{text} (RE2 syntax: no look-around, no back-references)") from None


@functools.lru_cache(maxsize=1 << 14)
def matches_whole(pattern: str, text: str) -> bool:
    """Tells whether the whole of `text` matches; `pattern` must be a regular expression."""
    if "\udc80" <= max(text, default="") <= "\udfff":
        return False  # bytes that are not UTF-8 are in no name
    return compiled(pattern).fullmatch(text) is not None
