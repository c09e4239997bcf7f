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
    """How one rule does.

    Attributes:
        action: "advertise", "flip" or "pull".
        gateway: the rule's gateway pattern; empty for an advertisement.
        rule: the rule.
        verdict: its state.
    """

    action: str
    gateway: str
    rule: Rule
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Remote:
    """Another gateway as we see it: what it tells all, and what it tells us."""

    record: Record
    request: PeerRequest = NO_REQUEST


@dataclass(frozen=True)
class Situation:
    """All that decides what to connect.

    Attributes:
        book: our rules.
        firewall: whether we refuse flips to us.
        local: our master's publishers, subscribers and services, without our own and without any gateway's proxies.
        connected: whether we are on a hub. Without one the remotes are those last seen.
        names: unique names of all other gateways that are alive.
        remotes: those of them that our rules or their requests concern, by unique name.
        links: how our imports do.
        namespace: our robot's; patterns bring nothing out of another robot's. "" where there is none.
        robots: namespaces of all robots that we have heard of.
        options: what is asked of links; the first that means a connection counts.
    """

    book: RuleBook
    firewall: bool
    local: frozenset[Connection]
    connected: bool
    names: frozenset[str] = frozenset()
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    links: Mapping[Import, LinkStatus] = field(default_factory=dict)
    options: tuple[OptionRule, ...] = ()
    namespace: str = ""
    robots: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Flipped:
    """A local connection that is flipped to a gateway, or a remote one that is flipped or pulled to here.

    Attributes:
        gateway: the other gateway's unique name.
        connection: the connection; its node is the one on the flipping or advertising side.
        status: a word of `gateway_msgs/RemoteRuleWithStatus`.
    """

    gateway: str
    connection: Connection
    status: str = "accepted"


@dataclass(frozen=True)
class Outcome:
    """What to do and what to say.

    Attributes:
        advertised: our public interface.
        requests: by unique name of the receiver; gateways that are absent get none.
        exports: what our relay shall export.
        imports: what our relay shall import.
        states: one for each rule, in the order advertisements, flips, pulls.
        flipped: local connections flipped away.
        flipped_in: remote connections flipped to here.
        pulled: remote connections pulled to here.
    """

    advertised: tuple[Connection, ...] = ()
    requests: Mapping[str, PeerRequest] = field(default_factory=dict)
    exports: frozenset[Export] = frozenset()
    imports: frozenset[Import] = frozenset()
    states: tuple[RuleState, ...] = ()
    flipped: tuple[Flipped, ...] = ()
    flipped_in: tuple[Flipped, ...] = ()
    pulled: tuple[Flipped, ...] = ()
