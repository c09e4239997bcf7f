"""What the control plane asks of the relay, and what the relay reports.

The control plane turns all rules into two sets and hands the relay the whole of both, each time; the relay
compares them with what runs and does the difference. Data always flows from an export to an import, and the
importing side dials. So a pull is an import here and an export there, a flipped publisher the other way round,
and a flipped subscriber an import, at the subscriber's gateway, of every publisher at the rule's gateway. Services and
parameters cross in the same way.
"""

import enum
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from rocon_relay.core.error import RelayError
from rocon_relay.core.latency import Latency
from rocon_relay.core.option import NO_OPTIONS, LinkOptions

ANY = "*"
"""Stands for any type or any MD5 sum, as in TCPROS."""

PROXY_PATH = "/relayed/"
"""How the path of every proxy node's XML-RPC URI begins; the name of the gateway it lives in follows."""


class ConnectionConflictError(RelayError):
    """Two exports or two imports of one call describe the same connection differently."""


class LinkState(enum.StrEnum):
    """How a link does; the words are the ones that rules use."""

    PENDING = "pending"
    """Not there yet: being set up (import), or not yet fetched by anybody (export)."""
    ACTIVE = "active"
    """The link is up and, for an import, the proxy is registered. Data flows while somebody subscribes."""
    RATE_LIMITED = "rate-limited"
    """Active, and by a rule's option not every message crosses."""
    NO_PUBLISHER = "no publisher"
    """The link is up, and its source node does not answer or does not publish the topic."""
    NO_SERVER = "no server"
    """The link is up, and the last call did not reach the server."""
    NO_PARAMETER = "no such parameter"
    """The far master does not have it. Asked again, at most `RelayConfig.retry_longest` later."""
    TYPE_MISMATCH = "type mismatch"
    """Type or MD5 sum differ between the two ends, or between import and publisher."""
    UNREACHABLE = "unreachable"
    """The far relay does not answer. It is dialled again, at most `RelayConfig.retry_longest` later."""
    REFUSED = "refused"
    """The far relay answers no: nothing exported to us, wrong credential, a loop. Asked again likewise."""


class Address(NamedTuple):
    """Where a relay listens for links: host name or IP address, and TCP port."""

    host: str
    port: int


class Subject(enum.StrEnum):
    """What a link is for: the field of its first header that holds the name."""

    TOPIC = "topic"
    SERVICE = "service"
    """Stands as long as the service is shown, and carries nothing."""
    CALL = "call"
    """One client's connection to a service."""
    PARAMETER = "parameter"


class Key(NamedTuple):
    """What tells the connections of one relay apart; `gateway` is the one at the other end."""

    topic: str
    gateway: str
    source_node: str
    subject: Subject = Subject.TOPIC


@dataclass(frozen=True, slots=True)
class Export:
    """Gateway `to_gateway` may fetch what our node publishes on a topic, call its service, or read a parameter."""

    #: resolved name of the topic, service or parameter, the same on both masters; a parameter that is a namespace is
    #: one with all that is in it
    topic: str
    type: str  #: of a topic, the message type as our master knows it, or `ANY`
    source_node: str  #: resolved name of a node on our master, never one of our proxies; "" for a parameter
    to_gateway: str  #: unique name of the gateway that may fetch
    options: LinkOptions = NO_OPTIONS  #: what our rules ask of the link
    #: the node as which we subscribe to the publisher; "" is our own node. Clients of actions want to see the server
    #: among their subscribers.
    subscriber: str = ""
    subject: Subject = Subject.TOPIC  #: which of the three it is

    @property
    def key(self) -> Key:
        """What may occur once in a call of `TcpRelay.apply`."""
        return Key(self.topic, self.to_gateway, self.source_node, self.subject)


@dataclass(frozen=True, slots=True)
class Import:
    """Our master shall show a node `proxy_name(...)` that publishes, or serves, what a node of another gateway does.

    Of a parameter, it shall be given the value that the other master has when we read it: once.
    """

    #: resolved name of the topic, service or parameter, the same on both masters. A service's may occur once in a call
    #: of `TcpRelay.apply`.
    topic: str
    type: str  #: message type, registered on our master; or `ANY`
    md5sum: str  #: what the publisher's MD5 sum must be, or `ANY`
    source_gateway: str  #: unique name of the gateway that exports
    source_node: str  #: resolved name of the publishing or serving node on that gateway's master; "" for a parameter
    address: Address  #: where that gateway's relay listens
    #: regular expressions, sorted, of which the whole name of a subscribing node must match one; none is any. They stay
    #: apart: flags and groups of one would mean something else, or nothing, in an expression that joins several.
    allowed_nodes: tuple[str, ...] = ()
    options: LinkOptions = NO_OPTIONS  #: what our rules ask of the link; the source does it
    subject: Subject = Subject.TOPIC  #: which of the three it is

    @property
    def key(self) -> Key:
        """What may occur once in a call of `TcpRelay.apply`."""
        return Key(self.topic, self.source_gateway, self.source_node, self.subject)

    @property
    def proxy(self) -> str:
        """The name of the node that stands for the source on our master."""
        return proxy_name(self.source_gateway, self.source_node)


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """How one export or import does. Counters run from the moment it was asked for."""

    state: LinkState  #: the state
    reason: str = ""  #: one sentence for people, "" when there is nothing to add
    #: import: local subscribers, or clients, now connected; export: 1 while the far side asks for data, or the clients
    #: that it has connected
    subscribers: int = 0
    #: whole messages that came from the source (import) or went towards the gateway (export); of a service, calls
    messages: int = 0
    bytes: int = 0  #: their bytes, the four of each length included; of a service, of requests and responses
    drops: int = 0  #: messages dropped for receivers that were too slow
    left_out: int = 0  #: export: messages that did not cross because of the link's options
    saved: int = 0  #: bytes of the messages that compression kept off the link


@dataclass(frozen=True, slots=True)
class RelayStatus:
    """How everything that was asked for by the last `TcpRelay.apply` does."""

    exports: Mapping[Export, LinkStatus] = field(default_factory=dict)  #: by what was asked for
    imports: Mapping[Import, LinkStatus] = field(default_factory=dict)  #: likewise
    #: by gateway, of those that a topic's link leads to or from
    latencies: Mapping[str, Latency] = field(default_factory=dict)


class Keyring(Protocol):
    """The keys of a fleet, by which gateways prove on links that they belong to it."""

    def names(self) -> tuple[str, ...]:
        """Returns the names of our keys, which are no secret; the one to prefer first."""

    def key(self, names: Iterable[str]) -> tuple[str, bytes] | None:
        """Returns the first of these that is ours, with the key; None if none is."""


@dataclass(frozen=True, slots=True)
class RelayConfig:
    """What a relay must know from the start. Times are wall time [s], monotonic."""

    gateway: str  #: our unique name, as on the hub
    node: str  #: our ROS node's name: what local publishers see as their subscriber
    master_uri: str  #: our master
    host: str  #: name or address of this machine that nodes of our master can reach (ROS_IP, ROS_HOSTNAME)
    port: int = 0  #: TCP port for links; 0 is any free one
    bind: str = ""  #: local address to listen on for links, "" is all
    node_bind: str = ""  #: local address where the proxies of far nodes listen for nodes of our master, "" is all
    keyring: Keyring | None = None  #: of the keys that all gateways share; None for none: see `docs/gateway.md`, Links
    max_message_size: int = 256 * 2**20  #: longest message that is carried [bytes]; a longer one closes its connection
    max_links: int = 1024  #: links that one other gateway may have open here at once, calls of services included
    ping_period: float = 5.0  #: between two measurements of the way to a gateway and back
    #: for how long nothing may come on a topic's link, whose far end is asked to say something meanwhile; it is noticed
    #: within a third more than this
    silence: float = 7.0
    queue_size: int = 1000  #: messages that wait for one slow receiver at most
    queue_bytes: int = 16 * 2**20  #: their bytes at most, though one message may always wait
    handshake_timeout: float = 5.0  #: within which a peer must have introduced itself
    call_timeout: float = 3.0  #: within which a master or node must have answered an XML-RPC call
    patience: float = 2.0  #: how long a far relay waits for an export that is asked for and not there yet
    retry_shortest: float = 0.1  #: first pause before a lost link is dialled again; doubles up to `retry_longest`
    retry_longest: float = 2.0  #: longest such pause


def proxy_name(gateway: str, node: str) -> str:
    """Returns the name under which `node` of `gateway` appears on our master: `/aadi1_gateway/pioneer1/amcl`.

    What a ROS name must not hold (spaces, dots, hyphens) becomes an underscore; a name that would begin
    with a digit or an underscore gets a `g` before it.
    """
    base = re.sub(r"[^A-Za-z0-9_]", "_", gateway)
    if not base[:1].isalpha():
        base = "g" + base
    return f"/{base}/{node.lstrip('/')}"


def proxy_uri(host: str, port: int, gateway: str) -> str:
    """Returns the XML-RPC URI of a proxy node that lives in our gateway `gateway`."""
    return f"http://{host}:{port}{PROXY_PATH}{re.sub(r'[^A-Za-z0-9_]', '_', gateway)}/"


def is_proxy_uri(uri: str) -> bool:
    """Tells whether a node's XML-RPC URI, as a master's lookupNode gives it, is some gateway's proxy.

    So that no gateway exports a proxy, not even one that a killed gateway left behind on the master.
    """
    return PROXY_PATH in uri
