"""Command lines of the form ``name:=value``, as roslaunch and rosrun know them."""

import dataclasses
import typing
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pioneer_gazebo.core.error import SimulatorError
from pioneer_node.core.document import nearest

Options = TypeVar("Options")


class ArgumentError(SimulatorError):
    """A command line that makes no sense."""


def option(default: Any, doc: str, variable: str = "") -> Any:
    """Returns a field of options: its default, what `usage` says of it, and an environment variable with its value."""
    return dataclasses.field(default=default, metadata={"doc": doc, "variable": variable})


def options_from_arguments(
    options: type[Options], arguments: Iterable[str], environ: Mapping[str, str], **defaults: Any
) -> Options:
    """Returns the dataclass ``options`` filled from ``name:=value`` words, and from the environment.

    Args:
        options: a dataclass whose fields are str, int, float or bool, each made by `option`.
        arguments: the words of the command line; remappings of roslaunch (``__name:=…``) are left out.
        environ: the environment, for what no word names; an empty variable does not count.
        defaults: values of fields that neither names.

    Raises:
        ArgumentError: a word of another form, a name that is no field, a value of the wrong type.
    """
    hints = typing.get_type_hints(options)
    values = dict(defaults)
    for field in dataclasses.fields(options):  # type: ignore[arg-type]
        variable = field.metadata["variable"]
        if environ.get(variable):
            values[field.name] = value_from_text(hints[field.name], environ[variable], variable)
    for word in arguments:
        name, separator, text = word.partition(":=")
        if name.startswith("__"):
            continue
        if not separator:
            raise ArgumentError(f"{word!r} is not of the form name:=value; names are {', '.join(hints)}")
        if name not in hints:
            raise ArgumentError(f"unknown argument {name!r}; {nearest(name, hints)}")
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


def usage(options: type) -> str:
    """Returns one line a field: its name, what it means, its variable and its default."""
    lines = []
    for field in dataclasses.fields(options):
        variable = f"; environment: {field.metadata['variable']}" if field.metadata["variable"] else ""
        default = "" if field.default in (dataclasses.MISSING, "") else f" (default {field.default})"
        lines.append(f"  {field.name}:=…  {field.metadata['doc']}{variable}{default}")
    return "\n".join(lines)
