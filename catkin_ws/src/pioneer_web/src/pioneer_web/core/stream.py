"""What pages get: a picture of everything once, then what has changed, each encoded once for all of them."""

from collections.abc import Mapping
from typing import Any

import orjson

_OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS
_ABSENT = object()


class Stream:
    """Values by name; a page merges what it gets into what it has."""

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}

    def update(self, values: Mapping[str, Any]) -> bytes:
        """Takes the newest values and returns those that are new, as JSON; empty where none is.

        A value that is unchanged must be the same object or compare equal; one that is missing becomes null.
        """
        changed = {name: value for name, value in values.items() if self._differs(name, value)}
        gone = [name for name in self._values if name not in values]
        self._values = dict(values)
        changed.update(dict.fromkeys(gone))
        return orjson.dumps(changed, option=_OPTIONS) if changed else b""

    def whole(self) -> bytes:
        """Returns all values as JSON, for a page that has none or has missed some."""
        return orjson.dumps(self._values, option=_OPTIONS)

    def _differs(self, name: str, value: Any) -> bool:
        before = self._values.get(name, _ABSENT)
        return before is not value and bool(before != value)
