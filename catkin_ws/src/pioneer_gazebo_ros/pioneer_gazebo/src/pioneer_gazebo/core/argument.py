"""Command lines of the form ``name:=value``, as roslaunch and rosrun know them."""

import dataclasses
import difflib
import typing
from collections.abc import Iterable
from typing import Any, TypeVar

from pioneer_gazebo.core.error import SimulatorError

Options = TypeVar("Options")


class ArgumentError(SimulatorError):
    """A command line that makes no sense."""


def options_from_arguments(options: type[Options], arguments: Iterable[str], **defaults: Any) -> Options:
    """Returns the dataclass ``options`` filled from ``name:=value`` words.

    Args:
        options: a dataclass whose fields are str, int, float or bool.
        arguments: the words of the command line; remappings of roslaunch (``__name:=…``) are left out.
        defaults: values of fields that no word names.

    Raises:
        ArgumentError: a word of another form, a name that is no field, a value of the wrong type.
    """
    hints = typing.get_type_hints(options)
    values = dict(defaults)
    for word in arguments:
        name, separator, text = word.partition(":=")
        if name.startswith("__"):
            continue
        if not separator:
            raise ArgumentError(f"{word!r} is not of the form name:=value; names are {', '.join(hints)}")
        if name not in hints:
            near = difflib.get_close_matches(name, hints, n=1)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(hints)}"
            raise ArgumentError(f"unknown argument {name!r}; {hint}")
        values[name] = value_from_text(hints[name], text, name)
    return options(**values)


def value_from_text(kind: type, text: str, name: str) -> Any:
    """Returns ``text`` as a str, int, float or bool.

    Raises:
        ArgumentError: it is none; the message names ``name``.
    """
    if kind is bool:
        if text.lower() not in ("true", "false", "1", "0"):
            raise ArgumentError(f"{name} must be true or false, not {text!r}")
        return text.lower() in ("true", "1")
    try:
        return kind(text)
    except ValueError:
        raise ArgumentError(f"{name} must be {'a whole number' if kind is int else 'a number'}, not {text!r}") from None


def usage(options: type, docs: dict[str, str]) -> str:
    """Returns one line a field: its name, its default and what ``docs`` says of it."""
    lines = []
    for field in dataclasses.fields(options):
        default = "" if field.default in (dataclasses.MISSING, "") else f" (default {field.default})"
        lines.append(f"  {field.name}:=…  {docs.get(field.name, '')}{default}")
    return "\n".join(lines)
