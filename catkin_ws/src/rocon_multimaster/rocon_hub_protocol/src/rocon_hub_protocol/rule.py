"""Rules and connections as values, as gateways write them on the hub."""

import enum
import re
from dataclasses import dataclass


class Kind(enum.StrEnum):
    """The kind of a connection, with the words of `gateway_msgs/ConnectionType` and our extension for parameters."""

    PUBLISHER = "publisher"
    SUBSCRIBER = "subscriber"
    SERVICE = "service"
    ACTION_CLIENT = "action_client"
    ACTION_SERVER = "action_server"
    PARAMETER = "parameter"


CONNECTIONS = tuple(kind for kind in Kind if kind != Kind.PARAMETER)
"""The kinds covered by the `*_all` services; parameters are copied only if requested by name."""


@dataclass(frozen=True, slots=True, order=True)
class Rule:
    """One kind, a pattern for names, and a pattern for nodes (empty: any)."""

    kind: Kind
    name: str
    node: str = ""

    def __str__(self) -> str:
        return f"{self.kind} {self.name}" + (f" of {self.node}" if self.node else "")


@dataclass(frozen=True, slots=True, order=True)
class RemoteRule:
    """A rule towards the gateways that `gateway` matches."""

    gateway: str
    rule: Rule

    def __str__(self) -> str:
        return f"{self.gateway}: {self.rule}"


@dataclass(frozen=True, slots=True, order=True)
class Connection:
    """The connection of one node with one topic, service or action. Names are resolved; type `*` if unknown."""

    kind: Kind
    name: str
    type: str
    node: str


LONGEST_NAME = 256
"""Maximum length of a topic, service, parameter, node, type or gateway name read from a hub [characters]."""

_NAME = re.compile(r"[~/A-Za-z][A-Za-z0-9_/]*")


def is_ros_name(text: str) -> bool:
    """Returns whether this is a valid ROS name, not longer than `LONGEST_NAME`."""
    return len(text) <= LONGEST_NAME and _NAME.fullmatch(text) is not None


def is_namespace(text: object) -> bool:
    """Returns whether this is a valid robot namespace: one ROS name without slashes."""
    return isinstance(text, str) and re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,255}", text) is not None
