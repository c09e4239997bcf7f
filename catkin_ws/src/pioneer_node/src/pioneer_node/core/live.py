"""Parameters that may change at run time: which configuration fields, and within which bounds."""

import dataclasses
import json
import math
import typing
from collections.abc import Mapping
from typing import Any

Value = bool | int | float | str

_KINDS = {bool: "bool", int: "int", float: "double", str: "str", Any: "str"}
_LONGEST_NAME = 60
"""Longer names are truncated in error messages."""
_UNBOUNDED: dict[str, tuple[Value, Value]] = {
    "bool": (False, True),
    "int": (-(2**31), 2**31 - 1),
    "double": (float("-inf"), float("inf")),
    "str": ("", ""),
}


@dataclasses.dataclass(frozen=True)
class Live:
    """Marks a configuration field as changeable at run time: ``speed: Annotated[float, Live(0.0, 20.0)] = 0.55``."""

    low: float | None = None  #: minimum, None for no limit
    high: float | None = None  #: maximum, None for no limit
    choices: tuple[tuple[str, Value], ...] = ()  #: allowed values, by name; empty for any
    whole: bool = False  #: whether clients see and set an integer although the field is a float


def one_of(*values: str) -> Live:
    """Marks a field that takes one of ``values``, named as in dynamic_reconfigure enumerations."""
    return Live(choices=tuple((f"{value.replace('-', '_')}_const", value) for value in values))


@dataclasses.dataclass(frozen=True)
class LiveParameter:
    """One parameter that may change at run time."""

    name: str  #: name of the configuration field
    kind: str  #: ``bool``, ``int``, ``double`` or ``str``
    default: Value  #: default of the configuration class
    low: Value  #: minimum; empty for strings
    high: Value  #: maximum; empty for strings
    choices: tuple[tuple[str, Value], ...] = ()  #: allowed values, by name; empty for any

    def clamped(self, value: Value) -> Value:
        """Returns ``value`` clamped to the bounds."""
        if self.kind not in ("int", "double"):
            return value
        return min(max(value, self.low), self.high)


def live_parameters(config_class: type[Any]) -> tuple[LiveParameter, ...]:
    """Returns the fields of a configuration dataclass that are marked ``Live``, in declaration order."""
    hints = typing.get_type_hints(config_class, include_extras=True)
    found = []
    for field in dataclasses.fields(config_class):
        hint = hints[field.name]
        marks = [mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, Live)]
        if marks:
            kind = "int" if marks[0].whole else _KINDS[hint.__origin__]
            found.append(_parameter(field.name, kind, field.default, marks[0]))
    return tuple(found)


def _parameter(name: str, kind: str, default: Any, mark: Live) -> LiveParameter:
    low, high = _UNBOUNDED[kind]
    number = int if kind == "int" else float
    low = low if mark.low is None else number(mark.low)
    high = high if mark.high is None else number(mark.high)
    return LiveParameter(name, kind, _plain(kind, default), low, high, mark.choices)


def _plain(kind: str, value: Any) -> Value:
    """Returns ``value`` in the form used by messages and the parameter server; lists become JSON text."""
    if kind == "int":
        return int(value)
    if kind == "str" and not isinstance(value, str):
        return json.dumps(value)
    return value  # type: ignore[no-any-return]


def live_values(config: Any) -> dict[str, Value]:
    """Returns the values of the parameters that may change at run time."""
    return {
        each.name: _plain(each.kind, getattr(config, each.name))
        for each in live_parameters(type(config))
    }


def accepted(
    parameters: tuple[LiveParameter, ...], wanted: Mapping[str, Value]
) -> tuple[dict[str, Value], list[str]]:
    """Returns the settable part of ``wanted``, clamped to the bounds, and one error line for each rejected value.

    Unknown names, values of the wrong kind and non-finite numbers are rejected.
    """
    known = {each.name: each for each in parameters}
    values: dict[str, Value] = {}
    complaints = []
    for name, value in wanted.items():
        kind = _KINDS[type(value)]
        if name not in known:
            complaints.append(f"no parameter {name[:_LONGEST_NAME]} can be changed here")
        elif kind != known[name].kind:
            complaints.append(f"{name} is of kind {known[name].kind}, not {kind}")
        elif isinstance(value, float) and not math.isfinite(value):
            complaints.append(f"{name} must be a finite number, not {value}")
        else:
            values[name] = known[name].clamped(value)
    return values, complaints
