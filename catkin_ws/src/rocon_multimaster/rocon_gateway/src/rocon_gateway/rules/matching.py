"""Matching of rules against names, nodes and gateways.

All patterns are regular expressions (RE2) over the whole text. In addition, a gateway matches its literal base name
(without the unique suffix), and a relative topic name in a rule matches the absolute one.
"""

import functools
import re
from collections.abc import Collection, Iterable

from rocon_gateway.error import RequestError
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import Connection, Kind, Rule
from rocon_relay import pattern as patterns
from rocon_relay.pattern import PatternError, matches_whole

ALL = ".*"
"""The name in a rule that the `*_all` services install."""

SUFFIX_LENGTH = 32
"""Number of hexadecimal digits that a gateway appends to its name to make it unique, unless disabled."""


def rule_from_text(kind: str, name: str, node: str, code: Code) -> Rule:
    """Returns a checked rule.

    Raises:
        RequestError: with `code`, for an unknown kind, an empty name, or an invalid regular expression.
    """
    try:
        known = Kind(kind)
    except ValueError:
        raise RequestError(
            code, f"unknown connection type '{kind}'; it is one of {', '.join(Kind)}"
        ) from None
    if not name:
        raise RequestError(code, f"a {known} rule needs a name")
    for what, pattern in (("name", name), ("node", node)):
        check_pattern(what, pattern, code)
    return Rule(known, name, node)


def check_pattern(what: str, pattern: str, code: Code) -> None:
    """Raises RequestError with `code` if `pattern` is not a regular expression."""
    try:
        patterns.check_pattern(pattern)
    except PatternError as error:
        raise RequestError(
            code, f"the {what} '{pattern}' is not a regular expression: {error}"
        ) from None


def is_literal(pattern: str) -> bool:
    """Returns whether `pattern` is a plain ROS name, which can only match itself."""
    return re.fullmatch(r"[A-Za-z0-9_/]+", pattern) is not None


def absolute_name(pattern: str) -> str:
    """Returns the absolute topic name for a literal name: `/chatter` for `chatter`."""
    return pattern if pattern.startswith("/") else "/" + pattern


def name_matches(pattern: str, name: str, own_gateway: str) -> bool:
    """Returns whether `pattern` matches topic `name`, absolute or relative to our gateway's name or the root."""
    if matches_whole(pattern, name):
        return True
    return pattern != ALL and any(
        name.startswith(prefix) and matches_whole(pattern, name[len(prefix) :])
        for prefix in (f"/{own_gateway}/", "/")
    )


def node_matches(pattern: str, node: str) -> bool:
    """Returns whether a rule's node pattern matches `node`; an empty one matches every node."""
    return not pattern or matches_whole(pattern, node)


def rule_matches(rule: Rule, connection: Connection, own_gateway: str) -> bool:
    """Returns whether `rule` matches `connection`."""
    return (
        rule.kind == connection.kind
        and name_matches(rule.name, connection.name, own_gateway)
        and node_matches(rule.node, connection.node)
    )


def blacklisting(blacklist: Iterable[Rule], connection: Connection) -> Rule | None:
    """Returns the first rule of `blacklist` that matches `connection`, None if there is none.

    Unlike other rules, blacklist rules do not support relative names: kind, name and node must match as given.
    """
    for rule in blacklist:
        if (
            rule.kind == connection.kind
            and matches_whole(rule.name, connection.name)
            and node_matches(rule.node, connection.node)
        ):
            return rule
    return None


def foreign_namespace(own: str, name: str, robots: Collection[str] = ()) -> str:
    """Returns the leading namespace of `name` if it belongs to another robot, else "".

    Args:
        own: our robot's namespace, such as `pioneer1`; one that differs only in the trailing number belongs to another
            robot. With "", no namespace does.
        name: a resolved name.
        robots: known robot namespaces of any form.
    """
    first = name.lstrip("/").partition("/")[0]
    stem = own.rstrip("0123456789")
    if not own or first == own:
        return ""
    differs_in_number = stem != own and re.fullmatch(re.escape(stem) + "[0-9]+", first)
    return first if differs_in_number or first in robots else ""


def asks_for(pattern: str, namespace: str) -> bool:
    """Returns whether a rule's name spells out a namespace: `/pioneer2/.*` does, `.*/odom` does not."""
    return pattern.lstrip("/").startswith(f"{namespace}/")


@functools.lru_cache(maxsize=4096)
def base_name(gateway: str) -> str:
    """Returns a gateway's name without the unique suffix, if it has one."""
    head, tail = gateway[:-SUFFIX_LENGTH], gateway[-SUFFIX_LENGTH:]
    return head if head and re.fullmatch(r"[0-9a-f]{32}", tail) else gateway


def gateway_matches(pattern: str, gateway: str) -> bool:
    """Returns whether a rule's `pattern` matches the whole unique name of `gateway`, or equals its base name."""
    return pattern in (gateway, base_name(gateway)) or matches_whole(pattern, gateway)


@functools.lru_cache(maxsize=512)
def gateways_meant(pattern: str, gateways: frozenset[str]) -> tuple[str, ...]:
    """Returns, sorted, those of `gateways` that a rule's `pattern` matches.

    Cached: it is called many times a second for all rules, and there may be a thousand gateways that rarely change.
    """
    return tuple(sorted(one for one in gateways if gateway_matches(pattern, one)))
