r"""Regular expressions in RE2 syntax, matched in linear time and compiled once each.

Python's own engine backtracks: it needs minutes to reject one long name for `/(\w+/?)+/odom`. RE2 does not support
look-ahead, look-behind, back-references, possessive quantifiers and atomic groups, and rejects them.
"""

import functools
import re

import re2

from rocon_relay.error import RelayError

LONGEST_PATTERN = 1024
"""Maximum length of a pattern [characters]."""
LONGEST_REMEMBERED = 256
"""Maximum length of a text whose matches are cached [characters]: clients of a ROS master choose the names there."""

_PLAIN = re.compile(r"[A-Za-z0-9_/]*", re.ASCII)
"""Patterns that match only themselves. Most are; they need no compiled form."""
_OPTIONS = re2.Options()
_OPTIONS.log_errors = False
_OPTIONS.max_mem = 1 << 20


class PatternError(RelayError):
    """The text is not a regular expression, or cannot be matched in linear time."""


@functools.lru_cache(maxsize=1024)
def compiled(pattern: str) -> "re2._Regexp[str]":
    """Returns the compiled pattern, cached. Raises PatternError if it is invalid."""
    if len(pattern) > LONGEST_PATTERN:
        raise PatternError(f"it has {len(pattern)} characters, more than {LONGEST_PATTERN}")
    try:
        return re2.compile(pattern, _OPTIONS)
    except (re2.error, UnicodeEncodeError) as error:
        reason = error.args[0] if isinstance(error, re2.error) else b"it is not valid UTF-8"
        text = reason.decode(errors="replace")
        raise PatternError(f"{text} (RE2 syntax: no look-around, no back-references)") from None


def check_pattern(pattern: str) -> None:
    """Raises PatternError if the text is not a regular expression."""
    if len(pattern) > LONGEST_PATTERN or not _PLAIN.fullmatch(pattern):
        compiled(pattern)


def matches_whole(pattern: str, text: str) -> bool:
    """Returns whether the whole `text` matches; `pattern` must be a valid regular expression."""
    if _PLAIN.fullmatch(pattern):
        return pattern == text
    if len(text) > LONGEST_REMEMBERED:
        return _matches(pattern, text)
    return _remembered_match(pattern, text)


def _matches(pattern: str, text: str) -> bool:
    try:
        return compiled(pattern).fullmatch(text) is not None
    except UnicodeEncodeError:
        return False  # no name contains invalid UTF-8


_remembered_match = functools.lru_cache(maxsize=1 << 13)(_matches)
