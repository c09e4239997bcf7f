"""A node's parameters as one frozen dataclass, checked once at start."""

import contextlib
import dataclasses
import difflib
import logging
import math
import types
import typing
from collections.abc import Collection, Iterator, Mapping
from typing import Any, TypeVar

Config = TypeVar("Config")


class ParameterError(ValueError):
    """A parameter has the wrong type, is out of range, or is unknown in strict mode."""


class UnknownNames:
    """Handles parameters that a node does not read: logs one warning for each, because Noetic ignores them."""

    def __init__(self) -> None:
        self.strict = False  #: whether to raise an error instead
        self._reported: set[str] = set()
        self._collected: list[str] | None = None
        self._noted: list[str] | None = None

    @contextlib.contextmanager
    def collected(self) -> Iterator[list[str]]:
        """Within this context the texts of unknown names are added to the list that it yields; nothing is logged."""
        before, self._collected = self._collected, []
        try:
            yield self._collected
        finally:
            self._collected = before

    @contextlib.contextmanager
    def noted(self) -> Iterator[list[str]]:
        """Within this context every warning is added to the list that it yields; nothing is logged or refused."""
        before, self._noted = self._noted, []
        try:
            yield self._noted
        finally:
            self._noted = before

    def report(self, owner: str, name: str, known: Collection[str], above: str = "") -> None:
        """Logs a warning that suggests the closest ``known`` name; ``above`` is their namespace with trailing slash.

        Raises:
            ParameterError: instead of the warning if ``strict``.
        """
        text = f"{owner}: unknown parameter ~{above}{name}{_nearest(name, known, above)}"
        if self._collected is not None:
            self._collected.append(text)
        else:
            self.complain(text)

    def complain(self, text: str) -> None:
        """Logs once that a parameter has no effect; ``text`` gives its name and the reason.

        Raises:
            ParameterError: instead of the warning if ``strict``.
        """
        self._warn(text, " It has no effect.")

    def correct(self, text: str) -> None:
        """Logs once that a value is taken as another one; ``text`` gives the name and both values.

        Raises:
            ParameterError: instead of the warning if ``strict``.
        """
        self._warn(text, "")

    def _warn(self, text: str, consequence: str) -> None:
        if self._noted is not None:
            line = f"{text if text.endswith('?') else f'{text}.'}{consequence}"
            self._noted.extend([line] if line not in self._noted else [])
            return
        if self._collected is not None:
            return
        if self.strict:
            raise ParameterError(text)
        if text not in self._reported:
            self._reported.add(text)
            # rospy's logger, whose output reaches the terminal and /rosout.
            logging.getLogger("rosout").warning(
                "%s%s", text if text.endswith("?") else f"{text}.", consequence
            )


@dataclasses.dataclass(frozen=True)
class WithoutEffect:
    """Marks a configuration field that is taken and not used: ``size: Annotated[float, WithoutEffect("why")] = 1.0``.

    A value other than the default causes a warning with the reason, which follows the parameter's name.
    """

    reason: str


ONLY_LIVE = WithoutEffect("acts only when it is set by dynamic_reconfigure")
"""For ``restore_defaults``."""


def without_effect(config_class: type[Any]) -> dict[str, str]:
    """Returns the reasons of the fields of a configuration dataclass that are marked ``WithoutEffect``, by name."""
    hints = typing.get_type_hints(config_class, include_extras=True)
    return {
        field.name: mark.reason
        for field in dataclasses.fields(config_class)
        for mark in getattr(hints[field.name], "__metadata__", ())
        if isinstance(mark, WithoutEffect)
    }


UNKNOWN = UnknownNames()
"""The process-wide instance; ``pioneer_node.nodes.entry.parameters`` sets ``strict`` from ``strict_parameters``."""


def config_from_mapping(
    config_class: type[Config],
    parameters: Mapping[str, Any],
    owner: str,
    ignored: Collection[str] = (),
) -> Config:
    """Returns ``config_class`` filled from ``parameters``; absent fields keep their defaults.

    Args:
        config_class: a frozen dataclass with one field per ROS parameter, of the same name.
        parameters: result of ``rospy.get_param("~", {})``.
        owner: the node's name, for error messages.
        ignored: names that are handled elsewhere (nested namespaces, dynamic parameters).

    Raises:
        ParameterError: a value has the wrong type, or a name is unknown and ``UNKNOWN`` is strict.
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
    config = config_class(**values)
    unused = without_effect(config_class)
    for field in dataclasses.fields(config_class):
        if field.name in unused and values.get(field.name, field.default) != field.default:
            UNKNOWN.complain(f"{owner}: ~{field.name} {unused[field.name]}")
    return config


def namespace_in(parameters: Mapping[str, Any], name: str, owner: str) -> Mapping[str, Any]:
    """Returns the parameters in the namespace ``name``: none if there is no such namespace, or if it is a value."""
    found = parameters.get(name, {})
    if isinstance(found, Mapping):
        return found
    UNKNOWN.complain(f"{owner}: ~{name} is {found!r}, but must be a namespace of parameters")
    return {}


def _nearest(name: str, names: Collection[str], above: str) -> str:
    matches = difflib.get_close_matches(name, names, n=1)
    return f"; did you mean ~{above}{matches[0]}?" if matches else ""


def value_as(hint: Any, value: Any, what: str) -> Any:
    """Returns ``value`` as the field's type.

    As roscpp does, an integer is taken for a float, and a float is rounded to an integer. Numbers and flags in quotes,
    and 0 or 1 for a flag, are taken as what they stand for, with a warning.

    Raises:
        ParameterError: the value stands for nothing of this type.
    """
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
    wanted = origin or hint
    if wanted in (int, float, bool):
        value = _plain_value(wanted, value, what)
    if wanted is float and isinstance(value, float) and not math.isfinite(value):
        raise ParameterError(f"{what} must be a finite number, not {value}")
    if not isinstance(value, wanted) or (wanted is int and isinstance(value, bool)):
        raise ParameterError(f"{what} must be {getattr(wanted, '__name__', wanted)}, not {value!r}")
    return value


_FLAGS = {"true": True, "false": False, "1": True, "0": False}


def _plain_value(wanted: type, value: Any, what: str) -> Any:
    """Returns a number or flag as the type ``wanted``; what cannot be converted stays as it is."""
    plain = value
    if isinstance(value, str):
        plain = _from_text(wanted, value.strip())
    if wanted is bool and isinstance(plain, (int, float)) and plain in (0, 1):
        plain = bool(plain)
    elif wanted is float and isinstance(plain, int) and not isinstance(plain, bool):
        plain = float(plain)
    elif wanted is int and isinstance(plain, float) and math.isfinite(plain):
        # As roscpp rounds: halves go up.
        plain = math.floor(plain + 0.5)
    if (
        isinstance(plain, wanted)
        and plain is not value
        and (isinstance(value, str) or plain != value or wanted is bool)
    ):
        UNKNOWN.correct(f"{what} is {value!r}, taken as {plain!r}")
    return plain


def _from_text(wanted: type, text: str) -> Any:
    """Returns the number or flag that a text in quotes stands for, else the text."""
    if wanted is bool:
        return _FLAGS.get(text.lower(), text)
    try:
        return float(text)
    except ValueError:
        return text
