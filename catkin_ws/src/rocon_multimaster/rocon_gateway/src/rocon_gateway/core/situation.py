"""What the reconciler looks at, and what it answers."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from rocon_gateway.core.option_rule import OptionRule
from rocon_gateway.core.rulebook import RuleBook
from rocon_hub_protocol.core.record import NO_REQUEST, PeerRequest, Record
from rocon_hub_protocol.core.rule import Connection, Rule
from rocon_relay.core.connection import Export, Import, LinkStatus


class State(enum.StrEnum):
    """How a rule does. Where several connections belong to a rule, the best state among them is the rule's."""

    ACTIVE = "active"
    RATE_LIMITED = "rate-limited"
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


WORKING = frozenset({str(State.ACTIVE), str(State.RATE_LIMITED)})
"""The states of a rule that does what it is to do."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A state, and one sentence on it for people (empty where there is nothing to add)."""

    state: str
    reason: str = ""


@dataclass(frozen=True, slots=True)
class RuleState:
    """How one rule does."""

    action: str  #: "advertise", "flip" or "pull"
    gateway: str  #: the rule's gateway pattern; empty for an advertisement
    rule: Rule  #: the rule
    verdict: Verdict  #: its state


@dataclass(frozen=True, slots=True)
class Remote:
    """Another gateway as we see it: what it tells all, and what it tells us."""

    record: Record
    request: PeerRequest = NO_REQUEST


@dataclass(frozen=True)
class Situation:
    """All that decides what to connect."""

    book: RuleBook  #: our rules
    firewall: bool  #: whether we refuse flips to us
    #: our master's publishers, subscribers and services, without our own and without any gateway's proxies
    local: frozenset[Connection]
    connected: bool  #: whether we are on a hub. Without one the remotes are those last seen.
    names: frozenset[str] = frozenset()  #: unique names of all other gateways that are alive
    #: those of them that our rules or their requests concern, by unique name
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    links: Mapping[Import, LinkStatus] = field(default_factory=dict)  #: how our imports do
    options: tuple[OptionRule, ...] = ()  #: what is asked of links; the first that means a connection counts
    namespace: str = ""  #: our robot's; patterns bring nothing out of another robot's. "" where there is none.
    robots: frozenset[str] = frozenset()  #: namespaces of all robots that we have heard of


@dataclass(frozen=True, slots=True)
class Flipped:
    """A local connection that is flipped to a gateway, or a remote one that is flipped or pulled to here."""

    gateway: str  #: the other gateway's unique name
    connection: Connection  #: the connection; its node is the one on the flipping or advertising side
    status: str = "accepted"  #: a word of `gateway_msgs/RemoteRuleWithStatus`


@dataclass(frozen=True)
class Outcome:
    """What to do and what to say."""

    advertised: tuple[Connection, ...] = ()  #: our public interface
    #: by unique name of the receiver; gateways that are absent get none
    requests: Mapping[str, PeerRequest] = field(default_factory=dict)
    exports: frozenset[Export] = frozenset()  #: what our relay shall export
    imports: frozenset[Import] = frozenset()  #: what our relay shall import
    states: tuple[RuleState, ...] = ()  #: one for each rule, in the order advertisements, flips, pulls
    flipped: tuple[Flipped, ...] = ()  #: local connections flipped away
    flipped_in: tuple[Flipped, ...] = ()  #: remote connections flipped to here
    pulled: tuple[Flipped, ...] = ()  #: remote connections pulled to here
