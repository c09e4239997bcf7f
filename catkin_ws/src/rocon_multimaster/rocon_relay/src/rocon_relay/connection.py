"""The interface between control plane and relay: requested connections, their status, and the configuration.

The control plane translates all rules into two sets, exports and imports, and always passes both completely. The relay
compares them with the running connections and applies the difference. Data always flows from an export to an import;
the import side connects. So a pull is an import here and an export on the far gateway; a flipped publisher is the
reverse. A flipped subscriber becomes an import, at the subscriber's gateway, of every publisher at the rule's gateway.
Services and parameters work in the same way.
"""

import enum
import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from rocon_relay.error import RelayError
from rocon_relay.latency import Latency
from rocon_relay.option import NO_OPTIONS, LinkOptions

ANY = "*"
"""Matches any type or MD5 sum, as in TCPROS."""

PROXY_PATH = "/relayed/"
"""Start of the path in every proxy node's XML-RPC URI, followed by the name of its gateway."""


class ConnectionConflictError(RelayError):
    """Two exports or two imports of one call describe the same connection differently."""


class LinkState(enum.StrEnum):
    """State of a link; the words are also used for rules."""

    PENDING = "pending"
    """Import: being set up. Export: the far gateway has not connected yet."""
    ACTIVE = "active"
    """The link is up and, for an import, the proxy is registered. Data flows while there are subscribers."""
    RATE_LIMITED = "rate-limited"
    """Active, but a rule limits the message rate."""
    MTU = "mtu"
    """Import: active, but full packets do not arrive, so the link uses smaller TCP segments."""
    NO_PUBLISHER = "no publisher"
    """The link is up, but the source node does not answer or does not publish the topic."""
    NO_SERVER = "no server"
    """The link is up, but the last call did not reach the server."""
    NO_PARAMETER = "no such parameter"
    """The far master does not have it. Retried after at most `RelayConfig.retry_longest`."""
    TYPE_MISMATCH = "type mismatch"
    """Type or MD5 sum differ between the two ends, or between import and publisher."""
    UNREACHABLE = "unreachable"
    """The far relay does not answer. Retried after at most `RelayConfig.retry_longest`."""
    REFUSED = "refused"
    """The far relay refuses: nothing exported to us, wrong credential, a loop. Retried likewise."""


class Address(NamedTuple):
    """Where a relay listens for links: host name or IP address, and TCP port."""

    host: str
    port: int


class Subject(enum.StrEnum):
    """What a link carries. The value is also the field of its hello that holds the name."""

    TOPIC = "topic"
    SERVICE = "service"
    """A permanent link, open as long as the service is offered; carries no data."""
    CALL = "call"
    """One client's connection to a service."""
    PARAMETER = "parameter"


class Key(NamedTuple):
    """Identifies a connection within one relay; `gateway` is the one at the other end."""

    topic: str
    gateway: str
    source_node: str
    subject: Subject = Subject.TOPIC


@dataclass(frozen=True, slots=True)
class Export:
    """Allows gateway `to_gateway` to subscribe to a topic of our node, call its service, or read a parameter."""

    #: resolved name of the topic, service or parameter, the same on both masters; a parameter namespace is exported
    #: as a whole
    topic: str
    type: str  #: message type of a topic as known to our master, or `ANY`
    source_node: (
        str  #: resolved name of a node on our master, never one of our proxies; "" for a parameter
    )
    to_gateway: str  #: unique name of the importing gateway
    options: LinkOptions = NO_OPTIONS  #: link options of our rules
    #: node name to use when subscribing to the publisher; "" is our own node. Action clients expect the server among
    #: their subscribers.
    subscriber: str = ""
    subject: Subject = Subject.TOPIC  #: topic, service or parameter

    @property
    def key(self) -> Key:
        """Identifies the export; must be unique in a call of `TcpRelay.apply`."""
        return Key(self.topic, self.to_gateway, self.source_node, self.subject)


@dataclass(frozen=True, slots=True)
class Import:
    """Registers a proxy node `proxy_name(...)` on our master for a topic or service of another gateway's node.

    A parameter is instead copied to our master once, with the value that the other master has at that time.
    """

    #: resolved name of the topic, service or parameter, the same on both masters. The name of a service must be unique
    #: in a call of `TcpRelay.apply`.
    topic: str
    type: str  #: message type, registered on our master; or `ANY`
    md5sum: str  #: required MD5 sum of the publisher, or `ANY`
    source_gateway: str  #: unique name of the gateway that exports
    source_node: str  #: resolved name of the publishing or serving node on that gateway's master; "" for a parameter
    address: Address  #: where that gateway's relay listens
    #: sorted regular expressions; the whole name of a subscribing node must match one of them; empty allows all nodes.
    #: Not joined into one expression, because flags and groups of one could change the meaning of another.
    allowed_nodes: tuple[str, ...] = ()
    options: LinkOptions = NO_OPTIONS  #: link options of our rules, applied by the source
    subject: Subject = Subject.TOPIC  #: topic, service or parameter
    #: name of that gateway in the proxy's name, if its own name cannot be used; see `aliases`
    alias: str = ""

    @property
    def key(self) -> Key:
        """Identifies the import; must be unique in a call of `TcpRelay.apply`."""
        return Key(self.topic, self.source_gateway, self.source_node, self.subject)

    @property
    def proxy(self) -> str:
        """The name of the proxy node on our master."""
        return proxy_name(self.alias or self.source_gateway, self.source_node)


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """Status of one export or import. Counters start when it is requested."""

    state: LinkState  #: the state
    reason: str = ""  #: one sentence for people, "" if there is nothing to add
    #: import: connected local subscribers or clients; export: 1 while the far side wants data, or for a service its
    #: connected clients
    subscribers: int = 0
    #: whole messages received from the source (import) or sent to the gateway (export); for a service, calls
    messages: int = 0
    bytes: int = (
        0  #: their size including the 4-byte lengths; for a service, of requests and responses
    )
    drops: int = 0  #: messages dropped because a receiver was too slow
    left_out: int = 0  #: export: messages not sent because of the link's options
    saved: int = 0  #: bytes saved by compression


@dataclass(frozen=True, slots=True)
class RelayStatus:
    """Status of all connections requested by the last `TcpRelay.apply`."""

    exports: Mapping[Export, LinkStatus] = field(default_factory=dict)  #: status by export
    imports: Mapping[Import, LinkStatus] = field(default_factory=dict)  #: status by import
    #: by gateway, for gateways with a topic link to or from us
    latencies: Mapping[str, Latency] = field(default_factory=dict)


class Keyring(Protocol):
    """The keys of a fleet, used by gateways to prove membership on links."""

    def names(self) -> tuple[str, ...]:
        """Returns the names of our keys, preferred one first. The names are not secret."""

    def key(self, names: Iterable[str]) -> tuple[str, bytes] | None:
        """Returns name and key of the first of these that we have; None if we have none."""


@dataclass(frozen=True, slots=True)
class RelayConfig:
    """Configuration of a relay. Times are monotonic wall time [s]."""

    gateway: str  #: our unique name, as on the hub
    node: str  #: our ROS node's name, as seen by local publishers
    master_uri: str  #: our master
    host: str  #: name or address of this machine, reachable by nodes of our master (ROS_IP, ROS_HOSTNAME)
    port: int = 0  #: TCP port for links; 0 is any free one
    bind: str = ""  #: local address to listen on for links, "" is all
    node_bind: str = (
        ""  #: local address where proxy nodes listen for nodes of our master, "" is all
    )
    keyring: Keyring | None = (
        None  #: keys shared by all gateways, or None: see `docs/gateway.md`, Links
    )
    max_message_size: int = (
        256 * 2**20
    )  #: maximum message size [bytes]; a longer message closes its connection
    max_links: int = 1024  #: maximum number of links from one other gateway, service calls included
    ping_period: float = 5.0  #: interval of round-trip measurements
    #: heartbeat timeout: a topic link that receives nothing for this long, although we ping, is closed; detected within
    #: a third more than this
    silence: float = 7.0
    queue_size: int = 1000  #: maximum number of messages queued for one slow receiver
    queue_bytes: int = 16 * 2**20  #: maximum size of that queue; one message may always wait
    handshake_timeout: float = 5.0  #: timeout for a peer to complete the handshake
    call_timeout: float = 3.0  #: timeout for XML-RPC calls to masters and nodes
    patience: float = (
        2.0  #: how long a link waits for an export that does not exist yet before it is refused
    )
    retry_shortest: float = (
        0.1  #: first pause before a lost link is reopened; doubles up to `retry_longest`
    )
    retry_longest: float = 2.0  #: longest pause


def proxy_name(gateway: str, node: str) -> str:
    """Returns the name under which `node` of `gateway` appears on our master: `/aadi1_gateway/pioneer1/amcl`.

    Characters not allowed in ROS names (spaces, dots, hyphens) become underscores. A name that would begin with a
    digit or an underscore gets the prefix `g`.
    """
    return f"/{_proxy_base(gateway)}/{node.lstrip('/')}"


def _proxy_base(gateway: str) -> str:
    base = re.sub(r"[^A-Za-z0-9_]", "_", gateway)
    return base if base[:1].isalpha() else "g" + base


def aliases(gateways: Iterable[str]) -> dict[str, str]:
    """Returns other names for the gateways whose names would make the same proxy names: `pi-1` and `pi_1`.

    A gateway whose name is a ROS name keeps it. The others get a suffix that depends on their name only.
    """
    by_base: dict[str, list[str]] = {}
    for gateway in gateways:
        by_base.setdefault(_proxy_base(gateway), []).append(gateway)
    return {
        gateway: f"{base}_{hashlib.sha256(gateway.encode()).hexdigest()[:4]}"
        for base, alike in by_base.items()
        if len(alike) > 1
        for gateway in alike
        if gateway != base
    }


def proxy_uri(host: str, port: int, gateway: str) -> str:
    """Returns the XML-RPC URI of a proxy node in our gateway `gateway`."""
    return f"http://{host}:{port}{PROXY_PATH}{re.sub(r'[^A-Za-z0-9_]', '_', gateway)}/"


def is_proxy_uri(uri: str) -> bool:
    """Returns whether a node's XML-RPC URI, as returned by lookupNode, belongs to a proxy of any gateway.

    This keeps gateways from exporting proxies, even those left on the master by a killed gateway.
    """
    return PROXY_PATH in uri


def gateway_in_proxy_uri(uri: str) -> str:
    """Returns the name of the gateway in a proxy's XML-RPC URI, as `proxy_uri` writes it; "" in any other URI."""
    _, _, path = uri.partition(PROXY_PATH)
    return path.rstrip("/")
