"""Collects the decisions of one `reconcile`: exports, imports, requests, and the state of each import."""

import dataclasses
import functools
from collections.abc import Callable
from typing import TypeVar

from rocon_gateway.rules import verdict
from rocon_gateway.rules.action import status_topic
from rocon_gateway.rules.matching import foreign_namespace
from rocon_gateway.rules.option_rule import OptionRule, rule_for
from rocon_gateway.rules.situation import Remote, Situation, State, Verdict
from rocon_hub_protocol.record import NO_REQUEST, Offer, PeerRequest, Purpose, Reply, Want
from rocon_hub_protocol.rule import Connection, Kind
from rocon_relay.connection import ANY, Address, Export, Import, Key, Subject, aliases
from rocon_relay.option import NO_OPTIONS

PendingVerdict = Callable[[], Verdict]
"""Returns the verdict on a connection; may be called once all imports are known."""

Part = TypeVar("Part", Offer, Want, Reply)

_SUBJECTS = {Kind.SERVICE: Subject.SERVICE, Kind.PARAMETER: Subject.PARAMETER}
"""Link subjects of connections that are not topics."""


class Decision:
    """Accumulates decisions while rules and requests are processed; complete after the last one.

    Args:
        situation: the input of the reconciliation.
    """

    def __init__(self, situation: Situation) -> None:
        self._situation = situation
        self._name = situation.book.name
        # A master lists one type per topic, and a subscriber may have set it. Only a publisher's
        # type counts: a subscriber of another type is refused alone.
        self._published_types: dict[str, str] = {}
        self._publishers_here: dict[str, set[str]] = {}
        for connection in situation.local:
            if connection.kind == Kind.PUBLISHER and connection.type != ANY:
                self._published_types[connection.name] = connection.type
                self._publishers_here.setdefault(connection.name, set()).add(connection.node)
        self._aliases = aliases_of(frozenset((*situation.names, *situation.remotes)))
        self._nodes_here = {one.node for one in situation.local}
        self._servers_here = {
            one.name: one.node for one in situation.local if one.kind == Kind.SERVICE
        }
        self._exports: dict[Key, Export] = {}
        self._imports: dict[Key, Import] = {}
        self._nodes: dict[Key, set[str]] = {}
        self._proxies: dict[tuple[str, str], Key] = {}
        self._services: dict[str, dict[Key, Import]] = {}
        self._parameters: dict[str, Import] = {}
        self._offers: dict[str, dict[Offer, None]] = {}
        self._wants: dict[str, dict[Want, None]] = {}
        self._replies: dict[str, dict[Reply, None]] = {}
        self._barring: set[str] = set()

    @property
    def barring(self) -> frozenset[str]:
        """The local nodes that bar an import, or would if they were not dead; complete after the last import."""
        return frozenset(self._barring)

    def _bars(self, *nodes: str) -> bool:
        """Returns whether any of these local nodes, each of which is in an import's way, is not dead."""
        self._barring.update(nodes)
        return not self._situation.dead.issuperset(nodes)

    # Requests

    def offer(
        self, gateway: str, connection: Connection, purpose: Purpose, to_node: str = ""
    ) -> None:
        """Offers `gateway` a publisher or server of ours, and exports it there."""
        _add(
            self._offers,
            gateway,
            Offer(connection.name, connection.type, connection.node, purpose, to_node),
        )
        self.export(gateway, connection)

    def want(self, gateway: str, want: Want) -> None:
        """Adds a want to our request to `gateway`."""
        _add(self._wants, gateway, want)

    def reply(self, gateway: str, reply: Reply) -> None:
        """Adds a reply to a request of `gateway`."""
        _add(self._replies, gateway, reply)

    def requests(self) -> dict[str, PeerRequest]:
        """Returns the request to each gateway; empty ones are left out."""
        requests = {
            gateway: PeerRequest(
                tuple(sorted(self._offers.get(gateway, ()))),
                tuple(sorted(self._wants.get(gateway, ()))),
                tuple(sorted(self._replies.get(gateway, ()))),
            )
            for gateway in {*self._offers, *self._wants, *self._replies}
        }
        return {gateway: request for gateway, request in requests.items() if request != NO_REQUEST}

    # Exports

    def export(self, gateway: str, connection: Connection) -> None:
        """Exports a publisher, server or parameter of ours to `gateway`."""
        subject = _SUBJECTS.get(connection.kind, Subject.TOPIC)
        options = (
            self._asked(connection, gateway).options if subject is Subject.TOPIC else NO_OPTIONS
        )
        export = Export(
            connection.name, connection.type, connection.node, gateway, options, subject=subject
        )
        self._exports.setdefault(export.key, export)

    def _asked(self, connection: Connection, gateway: str) -> OptionRule:
        return rule_for(
            self._situation.options, connection.name, connection.node, gateway, self._name
        )

    def exports(self) -> frozenset[Export]:
        """Returns all exports; call it after all imports are known."""
        servers: dict[tuple[str, str], str] = {}
        for key in sorted(self._imports, reverse=True):
            servers[key.gateway, key.topic] = self._imports[key].proxy
        return frozenset(
            dataclasses.replace(
                one, subscriber=servers.get((one.to_gateway, status_topic(one.topic)), "")
            )
            if one.subject is Subject.TOPIC
            else one
            for one in self._exports.values()
        )

    # Imports

    def import_publisher(
        self, gateway: str, other: Remote, connection: Connection, nodes: str
    ) -> PendingVerdict:
        """Imports a remote publisher for the nodes that match `nodes` (empty: any); returns its pending verdict."""
        here = self._published_types.get(connection.name, ANY)
        differs = ANY not in (here, connection.type) and here != connection.type
        if differs and self._bars(*self._publishers_here[connection.name]):
            return always(
                verdict.mismatch(connection.name, {self._name: here, gateway: connection.type})
            )
        if (refused := self.left_out(gateway, connection)) is not None:
            return always(refused)
        options = self._asked(connection, gateway).options
        wanted = Import(
            connection.name,
            connection.type,
            ANY,
            gateway,
            connection.node,
            _address(other),
            options=options,
            alias=self._aliases.get(gateway, ""),
        )
        clash = self._clash(wanted)
        if clash:
            return always(Verdict(State.REFUSED, clash))
        self._imports[wanted.key] = wanted
        self._nodes.setdefault(wanted.key, set()).add(nodes)
        return lambda: verdict.from_link(self._import_for(wanted.key), self._situation.links)

    def left_out(self, gateway: str, connection: Connection) -> Verdict | None:
        """Returns why an option excludes a remote publisher, as another robot's node; None if it is not excluded."""
        if self._asked(connection, gateway).foreign_nodes:
            return None
        situation = self._situation
        namespace = foreign_namespace(situation.namespace, connection.node, situation.robots)
        return verdict.foreign_node(connection.node, self._name) if namespace else None

    def import_service(self, gateway: str, other: Remote, connection: Connection) -> PendingVerdict:
        """Imports a remote server unless its name is taken; returns its pending verdict.

        A service name has only one server. A local server has priority; of several remote ones, the current one stays.
        """
        node, address = connection.node, _address(other)
        wanted = Import(
            connection.name,
            ANY,
            ANY,
            gateway,
            node,
            address,
            subject=Subject.SERVICE,
            alias=self._aliases.get(gateway, ""),
        )
        clash = self._service_clash(wanted)
        if clash:
            return always(Verdict(State.REFUSED, clash))
        self._services.setdefault(wanted.topic, {})[wanted.key] = wanted

        def judge() -> Verdict:
            chosen = self._chosen(wanted.topic)
            if chosen.key == wanted.key:
                return verdict.from_link(chosen, self._situation.links)
            return Verdict(
                State.REFUSED, f"{wanted.topic} is served by {chosen.proxy} here already"
            )

        return judge

    def import_parameter(
        self, gateway: str, other: Remote, connection: Connection
    ) -> PendingVerdict:
        """Copies a remote parameter once; returns its pending verdict. For one name, the first request wins."""
        wanted = Import(
            connection.name, ANY, ANY, gateway, "", _address(other), subject=Subject.PARAMETER
        )
        chosen = self._parameters.setdefault(wanted.topic, wanted)
        if chosen.source_gateway != gateway:
            return always(
                Verdict(State.REFUSED, f"{wanted.topic} is copied from {chosen.source_gateway}")
            )
        return lambda: verdict.from_link(wanted, self._situation.links)

    def imports(self) -> frozenset[Import]:
        """Returns all imports."""
        return frozenset(
            (
                *(self._import_for(key) for key in self._imports),
                *(self._chosen(service) for service in self._services),
                *self._parameters.values(),
            )
        )

    def _chosen(self, service: str) -> Import:
        candidates = self._services[service]
        running = {one.key for one in self._situation.links}
        return candidates[min(running & candidates.keys() or candidates)]

    def _service_clash(self, wanted: Import) -> str:
        server = self._servers_here.get(wanted.topic)
        if server and self._bars(server):
            return f"{wanted.topic} is served by {server} here already"
        return self._node_clash(wanted.proxy)

    def _node_clash(self, proxy: str) -> str:
        """Returns an error if the proxy's name is taken: registering it would shut down the existing node."""
        is_taken = proxy in self._nodes_here and self._bars(proxy)
        return f"a node {proxy} is here already" if is_taken else ""

    def _clash(self, wanted: Import) -> str:
        taken = self._node_clash(wanted.proxy)
        if taken:
            return taken
        key = self._proxies.setdefault((wanted.topic, wanted.proxy), wanted.key)
        return (
            ""
            if key == wanted.key
            else f"{wanted.proxy} stands for a node of gateway {key.gateway} already"
        )

    def _import_for(self, key: Key) -> Import:
        """Returns the import, merged for the nodes of all rules that request it."""
        nodes = self._nodes[key]
        if "" in nodes:
            return self._imports[key]
        # Sorted, so that the order of the rules does not change the import.
        return dataclasses.replace(self._imports[key], allowed_nodes=tuple(sorted(nodes)))


@functools.lru_cache(maxsize=8)
def aliases_of(gateways: frozenset[str]) -> dict[str, str]:
    """Returns `aliases`, cached because the gateways seldom change."""
    return aliases(gateways)


def always(said: Verdict) -> PendingVerdict:
    """Returns a pending verdict that is known already."""
    return lambda: said


def _address(other: Remote) -> Address:
    return Address(other.record.host, other.record.port)


def _add(parts: dict[str, dict[Part, None]], gateway: str, part: Part) -> None:
    parts.setdefault(gateway, {})[part] = None
