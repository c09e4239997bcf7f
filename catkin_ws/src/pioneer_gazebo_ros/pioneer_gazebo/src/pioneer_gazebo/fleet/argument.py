"""Parses command lines of the form ``name:=value``, as used by roslaunch and rosrun."""

import dataclasses
import typing
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pioneer_gazebo.error import SimulatorError
from pioneer_node.core.document import nearest

Options = TypeVar("Options")


class ArgumentError(SimulatorError):
    """Invalid command line."""


def option(default: Any, doc: str, variable: str = "") -> Any:
    """Returns an options field with its default, its text in `usage`, and an environment variable that can set it."""
    return dataclasses.field(default=default, metadata={"doc": doc, "variable": variable})


def options_from_arguments(
    options: type[Options], arguments: Iterable[str], environ: Mapping[str, str], **defaults: Any
) -> Options:
    """Returns the dataclass ``options`` filled from ``name:=value`` words and from the environment.

    Args:
        options: a dataclass whose fields are str, int, float or bool, each made by `option`.
        arguments: the words of the command line; roslaunch's special arguments (``__name:=…``) are ignored.
        environ: environment variables, overridden by words; empty variables are ignored.
        defaults: values of fields set by neither.

    Raises:
        ArgumentError: a word is not of this form, a name is unknown, or a value has the wrong type.
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
            raise ArgumentError(
                f"{word!r} is not of the form name:=value; names are {', '.join(hints)}"
            )
        if name not in hints:
            raise ArgumentError(f"unknown argument {name!r}; {nearest(name, hints)}")
        values[name] = value_from_text(hints[name], text, name)
    return options(**values)


def value_from_text(kind: type, text: str, name: str) -> Any:
    """Returns ``text`` as a str, int, float or bool.

    Raises:
        ArgumentError: the text is not of this type; the message contains ``name``.
    """
    if kind is bool:
        if text.lower() not in ("true", "false", "1", "0"):
            raise ArgumentError(f"{name} must be true or false, not {text!r}")
        return text.lower() in ("true", "1")
    try:
        return kind(text)
    except ValueError:
        raise ArgumentError(
            f"{name} must be {'a whole number' if kind is int else 'a number'}, not {text!r}"
        ) from None


def usage(options: type) -> str:
    """Returns one line per field: its name, meaning, environment variable and default."""
    lines = []
    for field in dataclasses.fields(options):
        variable = (
            f"; environment: {field.metadata['variable']}" if field.metadata["variable"] else ""
        )
        default = (
            "" if field.default in (dataclasses.MISSING, "") else f" (default {field.default})"
        )
        lines.append(f"  {field.name}:=…  {field.metadata['doc']}{variable}{default}")
    return "\n".join(lines)
