"""Where a hub is, how its keys are called, and who on it counts as present."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from rocon_gateway.core.code import Code, HubError
from rocon_gateway.core.situation import Remote

DEFAULT_PORT = 6380

TLS_SCHEME = "rediss"
"""The scheme of the address of a hub with TLS, as Redis' clients write it."""

NAME_KEY = "rocon:hub:name"
PROTOCOL_KEY = "rocon:hub:protocol"
GATEWAYS_KEY = "rocon:gateways"
"""The set of all gateways' names, and the channel on which joining and leaving is told."""
NAMESPACES_KEY = "rocon:namespaces"
"""The set of the namespaces of all robots that gateways told of since the hub was started."""
EXAMINE_KEY = "rocon:examine"
"""The channel on which all gateways are asked to look at their links; the message is a request's number."""


def record_key(gateway: str) -> str:
    """Returns the key of a gateway's record, and the channel that tells of its changes."""
    return f"rocon:gateway:{gateway}"


def alive_key(gateway: str) -> str:
    """Returns the key that exists while a gateway lives; its value is the gateway's instance."""
    return f"rocon:alive:{gateway}"


def letters_key(gateway: str) -> str:
    """Returns the key of the letters to a gateway (hash: sender to letter), and the channel that tells senders."""
    return f"rocon:letters:{gateway}"


def lost_key(gateway: str) -> str:
    """Returns the key that tells since when [s, the hub's clock] a gateway whose record is kept is not heard of."""
    return f"rocon:lost:{gateway}"


def examined_key(request: str) -> str:
    """Returns the channel on which gateways answer the request of that number."""
    return f"rocon:examined:{request}"


@dataclass(frozen=True, slots=True)
class HubAddress:
    """Where a hub's Redis listens.

    Attributes:
        host: its machine.
        port: its port.
        tls: whether it is known to speak TLS; no part of the address.
    """

    host: str
    port: int
    tls: bool = field(default=False, compare=False)

    def __str__(self) -> str:
        return f"{TLS_SCHEME if self.tls else 'http'}://{self.host}:{self.port}"


def address_from_uri(uri: str) -> HubAddress:
    """Returns the address in `http://host:port`, `host:port` or `host`; `rediss://host:port` for one with TLS.

    Raises:
        HubError: 12 for what is none of these.
    """
    found = re.fullmatch(r"(?:([a-z]+)://)?(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?/?", uri.strip())
    if not found:
        raise HubError(Code.HUB_CONNECTION_UNRESOLVABLE, f"'{uri}' is not a hub's address; write http://host:port")
    port = int(found[3] or DEFAULT_PORT)
    if not 0 < port < 65536:
        raise HubError(Code.HUB_CONNECTION_UNRESOLVABLE, f"'{uri}': there is no port {port}")
    return HubAddress(found[2].strip("[]"), port, found[1] == TLS_SCHEME)


def check_lists(
    address: HubAddress,
    name: str,
    whitelist: Collection[str],
    blacklist: Collection[str],
    aliases: Collection[HubAddress] = (),
) -> None:
    """Raises HubError: 13 for a hub on the blacklist, 15 for one that a non-empty whitelist lacks.

    Entries are hub names, or addresses as `address_from_uri` takes them; `aliases` are more addresses of this hub.
    """
    addresses = {_plain(one) for one in (address, *aliases)}
    if _listed(addresses, name, blacklist):
        raise HubError(Code.HUB_CONNECTION_BLACKLISTED, f"the hub '{name}' at {address} is blacklisted")
    if whitelist and not _listed(addresses, name, whitelist):
        text = f"the hub '{name}' at {address} is not on the whitelist"
        raise HubError(Code.HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST, text)


def _listed(addresses: Collection[HubAddress], name: str, entries: Collection[str]) -> bool:
    return any(entry == name or _address_in(entry) in addresses for entry in entries)


def _address_in(entry: str) -> HubAddress | None:
    """Returns the address that an entry of a list is, if it can be one."""
    try:
        return _plain(address_from_uri(entry))
    except HubError:
        return None


def _plain(address: HubAddress) -> HubAddress:
    return HubAddress("127.0.0.1", address.port) if address.host == "localhost" else address


@dataclass(frozen=True, slots=True)
class Candidate:
    """A hub to try.

    Attributes:
        address: where to dial.
        aliases: more addresses of it, as lists of allowed and refused hubs may have them.
    """

    address: HubAddress
    aliases: tuple[HubAddress, ...] = ()


@dataclass(frozen=True)
class HubView:
    """What we know of one hub and of the others on it; without a connection, what we knew last.

    Attributes:
        connected: whether we are on it now.
        hub_name: its name; empty when we were never there.
        hub_uri: its address; empty likewise.
        host: where the others on it reach us; empty likewise.
        listed: unique names of all gateways that the hub says are alive, ourselves apart.
        names: unique names of all that count as present: those, and some that it has just stopped listing.
        remotes: those of them that our rules or their letters concern.
        namespaces: of all robots that were told of there.
    """

    connected: bool = False
    hub_name: str = ""
    hub_uri: str = ""
    host: str = ""
    listed: frozenset[str] = frozenset()
    names: frozenset[str] = frozenset()
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    namespaces: frozenset[str] = frozenset()


class Presence:
    """Which gateways count as present when the hub no longer lists them.

    A gateway that takes its leave is gone at once. One that the hub merely stopped hearing of is gone at once
    too, unless our links to it still stand: then it, or its way to the hub, may only be slow, and it stays for
    `LINKED_GRACE`. A hub that was restarted knows nobody yet, so whoever was there before stays for
    `RESTART_GRACE`, and for `LINKED_GRACE` more if links stand. All times are monotonic [s].
    """

    LINKED_GRACE = 6.0
    RESTART_GRACE = 5.0

    def __init__(self) -> None:
        self.listed: set[str] = set()
        # Until when each stays without links, and until when with some.
        self._retained: dict[str, tuple[float, float]] = {}
        self._names: frozenset[str] = frozenset()

    @property
    def names(self) -> frozenset[str]:
        """All that are present; the same object as long as they are the same."""
        names = frozenset((*self.listed, *self._retained))
        if names != self._names:
            self._names = names
        return self._names

    @property
    def waiting(self) -> bool:
        """Whether somebody is only retained, so that `settle` must be called again."""
        return bool(self._retained)

    def start(self, listed: Collection[str], now: float) -> None:
        """Takes the list of a hub to which we have just connected."""
        alone = now + self.RESTART_GRACE
        # Who was retained already, too: while there was no hub, it could not return to it.
        for name in self.names - set(listed):
            self._retained[name] = (alone, alone + self.LINKED_GRACE)
        self.listed = set(listed)
        self._drop(self.listed)

    def join(self, name: str) -> None:
        """Somebody is there."""
        self.listed.add(name)
        self._drop((name,))

    def leave(self, name: str) -> None:
        """Somebody took its leave."""
        self.listed.discard(name)
        self._drop((name,))

    def expire(self, name: str, now: float) -> None:
        """The hub has not heard of somebody for too long."""
        if name in self.listed:
            self.listed.discard(name)
            self._retained[name] = (now, now + self.LINKED_GRACE)

    def settle(self, linked: Collection[str], now: float) -> bool:
        """Lets go of those whose time is over or whose links are down; tells whether there were any."""
        over = [
            name for name, (alone, together) in self._retained.items() if now >= (together if name in linked else alone)
        ]
        self._drop(over)
        return bool(over)

    def _drop(self, names: Collection[str]) -> None:
        for name in names:
            self._retained.pop(name, None)
