"""Rules and connections as values: what gateways write on the hub about themselves."""

import enum
import re
from dataclasses import dataclass


class Kind(enum.StrEnum):
    """What a rule is about, in the words of `gateway_msgs/ConnectionType`; parameters are ours."""

    PUBLISHER = "publisher"
    SUBSCRIBER = "subscriber"
    SERVICE = "service"
    ACTION_CLIENT = "action_client"
    ACTION_SERVER = "action_server"
    PARAMETER = "parameter"


CONNECTIONS = tuple(kind for kind in Kind if kind != Kind.PARAMETER)
"""What the `*_all` services mean by all: a parameter is copied only if it is asked for by its name."""


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
    """What one node has to do with one topic, service or action; names as resolved, type `*` where unknown."""

    kind: Kind
    name: str
    type: str
    node: str


LONGEST_NAME = 256
"""Longest name of a topic, service, parameter, node, type or gateway that is read from a hub [characters]."""

_NAME = re.compile(r"[~/A-Za-z][A-Za-z0-9_/]*")


def is_ros_name(text: str) -> bool:
    """Tells whether this is a name by ROS' grammar, and not longer than we take."""
    return len(text) <= LONGEST_NAME and _NAME.fullmatch(text) is not None


def is_namespace(text: object) -> bool:
    """Tells whether this can be a robot's namespace: one ROS name, without slashes."""
    return isinstance(text, str) and re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,255}", text) is not None
