"""A node's parameters as one frozen dataclass, checked once at start."""

import dataclasses
import difflib
import logging
import math
import types
import typing
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

Config = TypeVar("Config")


class ParameterError(ValueError):
    """A parameter of the wrong type or out of its range, or an unknown one where those are refused."""


class UnknownNames:
    """What happens to parameters that a node does not read: a warning each, once, as they have no effect in Noetic."""

    def __init__(self) -> None:
        self.strict = False  #: whether they are refused instead
        self._reported: set[str] = set()

    def report(self, owner: str, name: str, known: Collection[str], above: str = "") -> None:
        """Logs a warning that names the nearest of the ``known`` names; ``above`` is their namespace, with its slash.

        Raises:
            ParameterError: in place of the warning where ``strict``.
        """
        self.complain(f"{owner}: unknown parameter ~{above}{name}{_nearest(name, known, above)}")

    def complain(self, text: str) -> None:
        """Logs once that a parameter has no effect; ``text`` names it and the reason.

        Raises:
            ParameterError: in place of the warning where ``strict``.
        """
        if self.strict:
            raise ParameterError(text)
        if text not in self._reported:
            self._reported.add(text)
            # rospy's logger: what is logged there reaches the terminal and /rosout.
            logging.getLogger("rosout").warning("%s It has no effect.", text if text.endswith("?") else f"{text}.")


UNKNOWN = UnknownNames()
"""Of this process; ``pioneer_node.nodes.entry.parameters`` makes it strict where ``strict_parameters`` is set."""


def config_from_mapping(
    config_class: type[Config], parameters: Mapping[str, Any], owner: str, ignored: Collection[str] = ()
) -> Config:
    """Returns ``config_class`` filled from ``parameters``; fields that are absent keep their defaults.

    Args:
        config_class: a frozen dataclass whose fields are named as the ROS parameters are.
        parameters: what ``rospy.get_param("~", {})`` returned.
        owner: the node's name, for the error.
        ignored: names that belong to somebody else (nested namespaces, dynamic parameters).

    Raises:
        ParameterError: a value of the wrong type, or, where ``UNKNOWN`` is strict, a name that no field has.
    """
    hints = typing.get_type_hints(config_class)
    names = {field.name for field in dataclasses.fields(config_class)}
    values = {}
    for name, value in parameters.items():
        if name in ignored:
            continue
        if name not in names:
            UNKNOWN.report(owner, name, names)
            continue
        values[name] = value_as(hints[name], value, f"{owner}: parameter ~{name}")
    return config_class(**values)


def _nearest(name: str, names: Collection[str], above: str) -> str:
    matches = difflib.get_close_matches(name, names, n=1)
    return f"; did you mean ~{above}{matches[0]}?" if matches else ""


def value_as(hint: Any, value: Any, what: str) -> Any:
    """Returns ``value`` as the field's type: an int where a float is wanted becomes one, nothing else is converted."""
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        options = typing.get_args(hint)
        if value is None and type(None) in options:
            return None
        hint = next(option for option in options if option is not type(None))
        origin = typing.get_origin(hint)
    if origin is tuple and isinstance(value, (list, tuple)):
        return tuple(value)
    if hint is Any:
        return value
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if hint is float and isinstance(value, float) and not math.isfinite(value):
        raise ParameterError(f"{what} must be a finite number, not {value}")
    wanted = origin or hint
    if not isinstance(value, wanted) or (wanted is int and isinstance(value, bool)):
        raise ParameterError(f"{what} must be {getattr(wanted, '__name__', wanted)}, not {value!r}")
    return value
