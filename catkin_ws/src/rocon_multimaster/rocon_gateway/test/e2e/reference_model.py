"""What a fleet's rules bring, worked out from the tables in `docs/gateway.md` without any of the gateway's code.

Where the gateway collects requests and merges imports, this model asks one question at a time: does any rule bring this
publisher of that gateway to this subscriber? It knows topics, services, dead nodes, and nothing of time.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Rule:
    """A rule of one gateway. `action` is advertise, flip or pull; an advertisement has no gateway."""

    action: str
    gateway: str
    kind: str
    name: str
    node: str = ""

    def means(self, name: str, node: str) -> bool:
        """Returns whether the rule matches a connection."""
        return bool(re.fullmatch(self.name, name)) and self.takes(node)

    def takes(self, node: str) -> bool:
        """Returns whether the rule matches a node."""
        return not self.node or bool(re.fullmatch(self.node, node))

    @property
    def is_plain(self) -> bool:
        """Whether the name is no pattern."""
        return not re.search(r"[^\w/]", self.name)


@dataclass
class Node:
    """A node as its master lists it."""

    publishes: frozenset[str] = frozenset()
    latches: frozenset[str] = frozenset()  #: topics on which it published once
    subscribes: frozenset[str] = frozenset()
    serves: frozenset[str] = frozenset()
    lives: bool = True
    run: str = ""  #: unique for each start

    @property
    def sends(self) -> frozenset[str]:
        """All topics that it publishes."""
        return self.publishes | self.latches


@dataclass
class Gateway:
    """A gateway's rules, and the nodes that its master lists, by name."""

    rules: list[Rule] = field(default_factory=list)
    nodes: dict[str, Node] = field(default_factory=dict)


class Model:
    """The gateways of a fleet by name."""

    def __init__(self, names: list[str]) -> None:
        self.gateways = {name: Gateway() for name in names}

    def senders(self, here: str, topic: str) -> set[tuple[str, str]]:
        """Returns gateway and node of each publisher that is listed on a gateway's master, dead ones included."""
        found = set()
        for there, gateway in self.gateways.items():
            for name, node in gateway.nodes.items():
                if topic not in node.sends:
                    continue
                if there == here or any(self._ways(here, there, topic, name)):
                    found.add((there, name))
        return found

    def runs(self, here: str, listener: str, topic: str) -> set[str]:
        """Returns the runs of the living publishers whose messages a node gets."""
        found = set()
        for there, name in self.senders(here, topic):
            node = self.gateways[there].nodes[name]
            reaches = there == here or any(
                not allowed or re.fullmatch(allowed, listener)
                for allowed in self._allowed(here, there, topic, name)
            )
            if node.lives and reaches:
                found.add(node.run)
        return found

    def servers(self, here: str, service: str) -> list[tuple[str, Node]]:
        """Returns gateway and node of each server that may answer on a gateway's master: local ones have priority."""
        local = self._servers_at(here, service)
        living = [node for _, node in local if node.lives]
        if living:
            return [(here, node) for node in living]
        remote = [
            (there, node)
            for there in self.gateways
            if there != here
            for name, node in self._servers_at(there, service)
            if self._serves(here, there, service, name)
        ]
        return remote or [(here, node) for _, node in local]

    def forget_replaced(self, here: str, listed: Mapping[str, list[str]]) -> None:
        """Removes dead servers that a master, which lists one server for each service, has replaced by an import.

        Args:
            here: the master's gateway.
            listed: the server of each service according to the master.
        """
        for name, node in self.gateways[here].nodes.items():
            if not node.lives:
                node.serves = frozenset(one for one in node.serves if name in listed.get(one, []))

    def may_be_active(self, here: str, rule: Rule) -> set[bool]:
        """Returns whether a flip of a subscriber with a plain name may be active; either, with dead publishers only."""
        lives = {
            node.lives
            for there in self._targets(here, rule)
            for node in self.gateways[there].nodes.values()
            if rule.name in node.sends
        }
        if not lives:
            return {False}
        return {True} if True in lives else {True, False}

    def _servers_at(self, gateway: str, service: str) -> list[tuple[str, Node]]:
        nodes = self.gateways[gateway].nodes.items()
        return [(name, node) for name, node in nodes if service in node.serves]

    def _targets(self, owner: str, rule: Rule) -> list[str]:
        return [
            name
            for name in self.gateways
            if name != owner and (rule.gateway == name or re.fullmatch(rule.gateway, name))
        ]

    def _rules(self, owner: str, action: str, kind: str, target: str = "") -> Iterator[Rule]:
        for rule in self.gateways[owner].rules:
            is_alike = (rule.action, rule.kind) == (action, kind)
            if is_alike and (not target or target in self._targets(owner, rule)):
                yield rule

    def _ways(self, here: str, there: str, topic: str, node: str) -> Iterator[bool]:
        for _ in self._allowed(here, there, topic, node):
            yield True

    def _allowed(self, here: str, there: str, topic: str, node: str) -> Iterator[str]:
        """Yields, for each rule that brings a publisher, a pattern for the nodes that get it; "" for all."""
        listening = [
            name for name, one in self.gateways[here].nodes.items() if topic in one.subscribes
        ]
        for rule in self._rules(here, "flip", "subscriber", there):
            is_listening = any(rule.means(topic, name) for name in listening)
            if rule.name == topic if rule.is_plain else is_listening:
                yield rule.node
        if any(rule.means(topic, node) for rule in self._rules(there, "flip", "publisher", here)):
            yield ""
        if any(rule.means(topic, node) for rule in self._rules(there, "advertise", "publisher")):
            for rule in self._rules(here, "pull", "publisher", there):
                if rule.means(topic, node):
                    yield ""
        for name in listening:
            if any(one.means(topic, name) for one in self._rules(here, "advertise", "subscriber")):
                for rule in self._rules(there, "pull", "subscriber", here):
                    if rule.means(topic, name):
                        yield re.escape(name)

    def _serves(self, here: str, there: str, service: str, node: str) -> bool:
        if any(one.means(service, node) for one in self._rules(there, "flip", "service", here)):
            return True
        advertised = any(
            one.means(service, node) for one in self._rules(there, "advertise", "service")
        )
        return advertised and any(
            one.means(service, node) for one in self._rules(here, "pull", "service", there)
        )
