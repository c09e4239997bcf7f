"""Data stream to pages: a full snapshot first, then changes, each encoded once for all pages."""

from collections.abc import Callable, Mapping
from typing import Any

import orjson

_OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS
_ABSENT = object()


class Stream:
    """Named values; a page merges received changes into its state."""

    def __init__(self, on_fault: Callable[[str, str], None] = lambda name, reason: None) -> None:
        """Calls ``on_fault`` with name and reason once for each value that cannot be sent; it is sent as null."""
        self._on_fault = on_fault
        self._faults: set[str] = set()
        self._values: dict[str, Any] = {}

    def update(self, values: Mapping[str, Any]) -> bytes:
        """Stores the newest values; returns the changed ones as JSON, empty if nothing changed.

        An unchanged value must be the same object or compare equal. A missing one is sent as null.
        """
        changed = {name: value for name, value in values.items() if self._differs(name, value)}
        gone = [name for name in self._values if name not in values]
        self._values = dict(values)
        changed.update(dict.fromkeys(gone))
        return self._encoded(changed) if changed else b""

    def whole(self) -> bytes:
        """Returns a snapshot of all values as JSON, for a page that is new or missed changes."""
        return self._encoded(self._values)

    def _encoded(self, values: Mapping[str, Any]) -> bytes:
        try:
            return orjson.dumps(values, option=_OPTIONS)
        except orjson.JSONEncodeError:
            return orjson.dumps(
                {name: self._sound(name, value) for name, value in values.items()}, option=_OPTIONS
            )

    def _sound(self, name: str, value: Any) -> Any:
        """Returns a value that can be encoded: this one, or None."""
        try:
            orjson.dumps(value, option=_OPTIONS)
        except orjson.JSONEncodeError as error:
            if name not in self._faults:
                self._faults.add(name)
                self._on_fault(name, str(error))
            return None
        return value

    def _differs(self, name: str, value: Any) -> bool:
        before = self._values.get(name, _ABSENT)
        return before is not value and bool(before != value)
