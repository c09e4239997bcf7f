"""Rules for link options: the parameter `~rule_options`."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rocon_gateway.rules.matching import (
    ALL,
    check_pattern,
    gateway_matches,
    name_matches,
    node_matches,
)
from rocon_hub_protocol.code import Code
from rocon_relay.option import NO_OPTIONS, LinkOptions, OptionError, check_frames

_KEYS = ("name", "node", "gateway", *LinkOptions.__dataclass_fields__, "foreign_nodes")


@dataclass(frozen=True, slots=True)
class OptionRule:
    """Options for topics whose name, publishing node and other gateway match; patterns as in other rules."""

    name: str
    node: str
    gateway: str
    options: LinkOptions
    foreign_nodes: bool = (
        True  #: whether to import publishers that are nodes in another robot's namespace
    )


_NO_RULE = OptionRule(ALL, "", ALL, NO_OPTIONS)


def rule_for(
    rules: Iterable[OptionRule], topic: str, node: str, gateway: str, own_gateway: str
) -> OptionRule:
    """Returns the first rule that matches this connection with `gateway`, or one without options if none does."""
    for rule in rules:
        if (
            name_matches(rule.name, topic, own_gateway)
            and node_matches(rule.node, node)
            and gateway_matches(rule.gateway, gateway)
        ):
            return rule
    return _NO_RULE


def option_rule(row: object) -> OptionRule:
    """Parses one row of `~rule_options`, a mapping with some of `_KEYS`.

    Raises:
        OptionError: unknown key, invalid value, or no option at all.
        RequestError: a pattern is not a regular expression.
    """
    if not isinstance(row, Mapping):
        raise OptionError(f"{row!r} is not a mapping")
    unknown = sorted(map(str, set(row) - {*_KEYS}))
    if unknown:
        raise OptionError(f"unknown key {', '.join(unknown)}; there are {', '.join(_KEYS)}")
    patterns = {
        key: str(row.get(key) or otherwise) for key, otherwise in (("name", ALL), ("node", ""))
    }
    patterns["gateway"] = str(row.get("gateway") or ALL)
    for key, pattern in patterns.items():
        check_pattern(key, pattern, Code.HUB_UNKNOWN_ERROR)
    options = LinkOptions(
        _value(row, "rate", (int, float), 0.0),
        _value(row, "queue_size", (int,), 0),
        _choice(row, "compress", False),
        (row["tf_frames"],) if row.get("tf_frames") else (),
        _value(row, "stamp_rate", (int, float), 0.0),
    )
    for pattern in options.tf_frames:
        if not isinstance(pattern, str):
            raise OptionError(f"tf_frames is a pattern, not {pattern!r}")
        check_frames(pattern)
    found = OptionRule(
        **patterns, options=options, foreign_nodes=_choice(row, "foreign_nodes", True)
    )
    if found.foreign_nodes and options == NO_OPTIONS:
        raise OptionError(f"{dict(row)!r} asks for nothing")
    return found


def _choice(row: Mapping[Any, Any], key: str, otherwise: bool) -> bool:
    value = row.get(key, otherwise)
    if not isinstance(value, bool):
        raise OptionError(f"{key} is true or false, not {value!r}")
    return value


def _value(row: Mapping[Any, Any], key: str, kinds: tuple[type, ...], otherwise: Any) -> Any:
    value = row.get(key, otherwise)
    is_number = isinstance(value, kinds) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or (key in row and value <= 0):
        raise OptionError(f"{key} is {value!r}, not a number greater than 0")
    return value
