"""Converts a document of mappings, lists and values into frozen dataclasses; errors carry their place in it."""

import dataclasses
import difflib
import types
import typing
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

from pioneer_node.core.parameter import ParameterError, value_as

Place = tuple[str | int, ...]
"""Fields and indices from the document's root to a value."""

Kind = TypeVar("Kind")


class DocumentError(ParameterError):
    """The document is invalid."""

    def __init__(self, text: str, *place: str | int) -> None:
        super().__init__(text)
        self.place: Place = place  #: where the error is

    def within(self, *outer: str | int) -> "DocumentError":
        """Returns the error with its place relative to an enclosing document that contains this one at ``outer``."""
        return DocumentError(str(self), *outer, *self.place)


def nearest(name: str, known: Collection[str]) -> str:
    """Returns the hint for an unknown name in an error: the closest known name, else all known names."""
    near = difflib.get_close_matches(name, known, 1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(known))}"


def built(kind: type[Kind], content: Any, what: str = "the file") -> Kind:
    """Returns a dataclass filled from a mapping. Fields may be dataclasses, tuples or dicts of them, and unions.

    Args:
        kind: the dataclass; a `ParameterError` from its ``__post_init__`` is re-raised with its place.
        content: a mapping of its fields; absent fields keep their defaults.
        what: name of ``content`` in errors.

    Raises:
        DocumentError: an unknown field, a wrong type, or a value that ``kind`` rejects.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if not isinstance(content, Mapping):
        raise DocumentError(f"{what} must be a mapping of {', '.join(fields)}, not {content!r}")
    hints, values = typing.get_type_hints(kind), {}
    for name, value in content.items():
        if name not in fields:
            raise DocumentError(f"unknown field {name}; {nearest(str(name), fields)}", name)
        values[name] = _inside(hints[name], value, name, name)
    try:
        return kind(**values)
    except DocumentError:
        raise
    except ParameterError as error:
        raise DocumentError(str(error)) from None


def _inside(hint: Any, value: Any, what: str, *place: str | int) -> Any:
    try:
        return _converted(hint, value, what)
    except DocumentError as error:
        raise error.within(*place) from None
    except ParameterError as error:
        raise DocumentError(str(error), *place) from None


def _converted(hint: Any, value: Any, what: str) -> Any:
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _option(inner, value, what)
    if origin is tuple and isinstance(value, list):
        return tuple(
            _inside(inner[0], one, f"{what} {number + 1}", number)
            for number, one in enumerate(value)
        )
    if origin is dict and isinstance(value, Mapping):
        return {key: _inside(inner[1], one, f"{what} {key}", key) for key, one in value.items()}
    if dataclasses.is_dataclass(hint):
        return built(hint, value, what)  # type: ignore[arg-type]
    if origin is tuple:
        raise ParameterError(f"{what} must be a list, not {value!r}")
    return value_as(hint, value, what)


def _option(hints: tuple[Any, ...], value: Any, what: str) -> Any:
    """Returns the value as the union member that fits it: a tuple for a list, another type for a single value."""
    if value is None and type(None) in hints:
        return None
    lists = [hint for hint in hints if typing.get_origin(hint) is tuple]
    others = [hint for hint in hints if hint not in (*lists, type(None))]
    return _converted(
        (lists if lists and isinstance(value, list) else others or lists)[0], value, what
    )
