"""Input and output of the reconciler."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from rocon_gateway.rules.option_rule import OptionRule
from rocon_gateway.rules.rulebook import RuleBook
from rocon_hub_protocol.record import NO_REQUEST, PeerRequest, Record
from rocon_hub_protocol.rule import Connection, Rule
from rocon_relay.connection import Export, Import, LinkStatus


class State(enum.StrEnum):
    """State of a rule. A rule with several connections has the best state among them."""

    ACTIVE = "active"
    RATE_LIMITED = "rate-limited"
    MTU = "mtu"
    PENDING = "pending"
    NO_GATEWAY = "no such gateway"
    NO_TOPIC = "no such topic"
    NO_SERVICE = "no such service"
    NO_ACTION = "no such action"
    NO_PARAMETER = "no such parameter"
    NO_PUBLISHER = "no publisher"
    NO_SERVER = "no server"
    TYPE_MISMATCH = "type mismatch"
    BLACKLISTED = "blacklisted"
    FIREWALLED = "firewalled"
    UNREACHABLE = "unreachable"
    REFUSED = "refused"


WORKING = frozenset({str(State.ACTIVE), str(State.RATE_LIMITED), str(State.MTU)})
"""The states of a working rule."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A state and one explanatory sentence, empty if there is nothing to add."""

    state: str
    reason: str = ""


@dataclass(frozen=True, slots=True)
class RuleState:
    """The state of one rule."""

    action: str  #: "advertise", "flip" or "pull"
    gateway: str  #: the rule's gateway pattern; empty for an advertisement
    rule: Rule  #: the rule
    verdict: Verdict  #: its state


@dataclass(frozen=True, slots=True)
class Remote:
    """Another gateway as we see it: its public record and its request to us."""

    record: Record
    request: PeerRequest = NO_REQUEST


@dataclass(frozen=True)
class Situation:
    """The complete input of a reconciliation."""

    book: RuleBook  #: our rules
    firewall: bool  #: whether we refuse flips to us
    #: our master's publishers, subscribers and services, without our own and without any gateway's proxies
    local: frozenset[Connection]
    connected: bool  #: whether we are on a hub; without one, the remotes are those last seen
    names: frozenset[str] = frozenset()  #: unique names of all other live gateways
    #: those of them concerned by our rules or their requests, by unique name
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    links: Mapping[Import, LinkStatus] = field(default_factory=dict)  #: status of our imports
    options: tuple[
        OptionRule, ...
    ] = ()  #: rules for link options; the first that matches a connection applies
    namespace: str = (
        ""  #: our robot's namespace; patterns import nothing from another robot's. "" for none
    )
    robots: frozenset[str] = frozenset()  #: namespaces of all known robots
    #: those of `Outcome.barring` that are dead: registered, but nothing listens at their address
    dead: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Flipped:
    """A local connection flipped to another gateway, or a remote one flipped or pulled to this gateway."""

    gateway: str  #: the other gateway's unique name
    connection: (
        Connection  #: the connection; its node is the one on the flipping or advertising side
    )
    status: str = "accepted"  #: a word of `gateway_msgs/RemoteRuleWithStatus`


@dataclass(frozen=True)
class Outcome:
    """The result of a reconciliation."""

    advertised: tuple[Connection, ...] = ()  #: our public interface
    #: by unique name of the receiver; absent gateways get none
    requests: Mapping[str, PeerRequest] = field(default_factory=dict)
    exports: frozenset[Export] = frozenset()  #: the exports for our relay
    imports: frozenset[Import] = frozenset()  #: the imports for our relay
    states: tuple[
        RuleState, ...
    ] = ()  #: one for each rule, in the order advertisements, flips, pulls
    flipped: tuple[Flipped, ...] = ()  #: local connections flipped to other gateways
    flipped_in: tuple[Flipped, ...] = ()  #: remote connections flipped to this gateway
    pulled: tuple[Flipped, ...] = ()  #: remote connections pulled to this gateway
    #: local nodes whose registrations bar an import, or would if they were not dead
    barring: frozenset[str] = frozenset()
