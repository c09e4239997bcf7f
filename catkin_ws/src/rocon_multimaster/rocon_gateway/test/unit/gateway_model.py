"""Gateways on one hub, without a real hub, relay or master: each reconciles with what the others wrote."""

from dataclasses import dataclass, field

from rocon_gateway.rules.option_rule import OptionRule
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.rulebook import RuleBook
from rocon_gateway.rules.situation import Outcome, Remote, Situation
from rocon_hub_protocol.record import PeerRequest, Record, request_from_text, text_from_request
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule
from rocon_relay.connection import Import, LinkState, LinkStatus

STRING = "std_msgs/String"


def publisher(topic: str, node: str = "/talker", kind: str = STRING) -> Connection:
    return Connection(Kind.PUBLISHER, topic, kind, node)


def subscriber(topic: str, node: str = "/listener", kind: str = STRING) -> Connection:
    return Connection(Kind.SUBSCRIBER, topic, kind, node)


def service(name: str, node: str = "/server") -> Connection:
    return Connection(Kind.SERVICE, name, "*", node)


def to(gateway: str, kind: Kind, name: str, node: str = "") -> RemoteRule:
    return RemoteRule(gateway, Rule(kind, name, node))


@dataclass
class FakeGateway:
    book: RuleBook
    local: set[Connection] = field(default_factory=set)
    firewall: bool = False
    outcome: Outcome = field(default_factory=Outcome)
    links: dict[Import, LinkStatus] = field(default_factory=dict)
    options: tuple[OptionRule, ...] = ()
    namespace: str = ""
    dead: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        return self.book.name

    @property
    def record(self) -> Record:
        return Record(
            self.name,
            "i",
            self.name,
            4000,
            self.firewall,
            self.outcome.advertised,
            namespace=self.namespace,
        )

    def states(self) -> dict[str, str]:
        return {f"{one.action} {one.rule.name}": one.verdict.state for one in self.outcome.states}

    def reason(self, name: str) -> str:
        return next(one.verdict.reason for one in self.outcome.states if one.rule.name == name)

    def imported(self) -> set[tuple[str, str, str]]:
        return {
            (one.key.topic, one.source_gateway, one.key.source_node) for one in self.outcome.imports
        }


class Fleet:
    """Gateways on one hub whose links always work; `settle` repeats reconciliation until nothing changes."""

    def __init__(self, *gateways: FakeGateway) -> None:
        self.gateways = {gateway.name: gateway for gateway in gateways}

    def settle(self) -> "Fleet":
        for _ in range(10):
            before = {name: gateway.outcome for name, gateway in self.gateways.items()}
            for gateway in self.gateways.values():
                gateway.outcome = reconcile(self.situation(gateway))
                gateway.links = {
                    one: LinkStatus(_state_of_working(one)) for one in gateway.outcome.imports
                }
            if before == {name: gateway.outcome for name, gateway in self.gateways.items()}:
                self.check()
                return self
        raise AssertionError("the gateways never agree")

    def situation(self, gateway: FakeGateway) -> Situation:
        others = {name: other for name, other in self.gateways.items() if name != gateway.name}
        requests = {
            name: other.outcome.requests.get(gateway.name, PeerRequest())
            for name, other in others.items()
        }
        return Situation(
            book=gateway.book,
            firewall=gateway.firewall,
            local=frozenset(gateway.local),
            connected=True,
            names=frozenset(others),
            remotes={
                name: Remote(other.record, request_from_text(text_from_request(requests[name])))
                for name, other in others.items()
            },
            links=gateway.links,
            options=gateway.options,
            namespace=gateway.namespace,
            dead=gateway.dead,
            robots=frozenset(one.namespace for one in self.gateways.values() if one.namespace),
        )

    def check(self) -> None:
        """Asserts that imports and exports match exactly, and that each imported connection is the exporter's own."""
        imports = {
            (one.subject, one.source_gateway, name, one.key.topic, one.key.source_node)
            for name, gateway in self.gateways.items()
            for one in gateway.outcome.imports
        }
        exports = {
            (one.subject, name, one.to_gateway, one.key.topic, one.key.source_node)
            for name, gateway in self.gateways.items()
            for one in gateway.outcome.exports
        }
        assert imports <= exports
        for _, name, _, topic, node in exports:
            assert not node or any(
                (one.name, one.node) == (topic, node) for one in self.gateways[name].local
            )


def _state_of_working(wanted: Import) -> LinkState:
    return (
        LinkState.RATE_LIMITED
        if isinstance(wanted, Import) and wanted.options.rate
        else LinkState.ACTIVE
    )


def fleet_of(hub: FakeGateway, robot: FakeGateway) -> Fleet:
    return Fleet(hub, robot).settle()


def gateway(name: str, *local: Connection, firewall: bool = False) -> FakeGateway:
    return FakeGateway(RuleBook(name), set(local), firewall)
