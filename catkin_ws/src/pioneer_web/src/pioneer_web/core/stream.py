"""Data stream to pages: a full snapshot first, then changes, each encoded once for all pages."""

from collections.abc import Mapping
from typing import Any

import orjson

_OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS
_ABSENT = object()


class Stream:
    """Named values; a page merges received changes into its state."""

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}

    def update(self, values: Mapping[str, Any]) -> bytes:
        """Stores the newest values; returns the changed ones as JSON, empty if nothing changed.

        An unchanged value must be the same object or compare equal. A missing one is sent as null.
        """
        changed = {name: value for name, value in values.items() if self._differs(name, value)}
        gone = [name for name in self._values if name not in values]
        self._values = dict(values)
        changed.update(dict.fromkeys(gone))
        return orjson.dumps(changed, option=_OPTIONS) if changed else b""

    def whole(self) -> bytes:
        """Returns a snapshot of all values as JSON, for a page that is new or missed changes."""
        return orjson.dumps(self._values, option=_OPTIONS)

    def _differs(self, name: str, value: Any) -> bool:
        before = self._values.get(name, _ABSENT)
        return before is not value and bool(before != value)
