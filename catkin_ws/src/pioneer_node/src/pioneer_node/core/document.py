"""A document of mappings, lists and values as frozen dataclasses, with the place of each error in it."""

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
    """A document that cannot be used."""

    def __init__(self, text: str, *place: str | int) -> None:
        super().__init__(text)
        self.place: Place = place  #: of what is wrong

    def within(self, *outer: str | int) -> "DocumentError":
        """Returns the error as one of the document that has this one at ``outer``."""
        return DocumentError(str(self), *outer, *self.place)


def nearest(name: str, known: Collection[str]) -> str:
    """Returns what an error says after an unknown name: the nearest that exists, else all that exist."""
    near = difflib.get_close_matches(name, known, 1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(known))}"


def built(kind: type[Kind], content: Any, what: str = "the file") -> Kind:
    """Returns a dataclass filled from a mapping; fields may be dataclasses, tuples and dicts of such, and options.

    Args:
        kind: the dataclass; what its ``__post_init__`` raises as `ParameterError` gets its place.
        content: a mapping of its fields; those that are absent keep their defaults.
        what: name of ``content`` in errors.

    Raises:
        DocumentError: an unknown field, a wrong type, or what ``kind`` refuses.
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
        return tuple(_inside(inner[0], one, f"{what} {number + 1}", number) for number, one in enumerate(value))
    if origin is dict and isinstance(value, Mapping):
        return {key: _inside(inner[1], one, f"{what} {key}", key) for key, one in value.items()}
    if dataclasses.is_dataclass(hint):
        return built(hint, value, what)  # type: ignore[arg-type]
    if origin is tuple:
        raise ParameterError(f"{what} must be a list, not {value!r}")
    return value_as(hint, value, what)


def _option(hints: tuple[Any, ...], value: Any, what: str) -> Any:
    """Returns the value as the option that fits a list or a single value; the last one's error where none does."""
    if value is None and type(None) in hints:
        return None
    lists = [hint for hint in hints if typing.get_origin(hint) is tuple]
    others = [hint for hint in hints if hint not in (*lists, type(None))]
    return _converted((lists if lists and isinstance(value, list) else others or lists)[0], value, what)
