"""Hubs to try, the view of a hub, and which gateways on it count as present."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from rocon_gateway.rules.situation import Remote
from rocon_hub_protocol.address import HubAddress, address_from_uri
from rocon_hub_protocol.code import Code, HubError


def check_lists(
    address: HubAddress,
    name: str,
    whitelist: Collection[str],
    blacklist: Collection[str],
    aliases: Collection[HubAddress] = (),
) -> None:
    """Raises HubError: 13 for a hub on the blacklist, 15 for one missing from a non-empty whitelist.

    Entries are hub names, or addresses in the form of `address_from_uri`; `aliases` are further addresses of this hub.
    """
    addresses = {_plain(one) for one in (address, *aliases)}
    if _listed(addresses, name, blacklist):
        raise HubError(
            Code.HUB_CONNECTION_BLACKLISTED, f"the hub '{name}' at {address} is blacklisted"
        )
    if whitelist and not _listed(addresses, name, whitelist):
        text = f"the hub '{name}' at {address} is not on the whitelist"
        raise HubError(Code.HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST, text)


def names_address(entries: Collection[str], address: HubAddress) -> bool:
    """Returns whether one of `entries`, in the form of `check_lists`, is this address."""
    return any(_address_in(entry) == _plain(address) for entry in entries)


def _listed(addresses: Collection[HubAddress], name: str, entries: Collection[str]) -> bool:
    return any(entry == name or _address_in(entry) in addresses for entry in entries)


def _address_in(entry: str) -> HubAddress | None:
    """Returns a list entry as an address, None if it is not one."""
    try:
        return _plain(address_from_uri(entry))
    except HubError:
        return None


def _plain(address: HubAddress) -> HubAddress:
    return HubAddress("127.0.0.1", address.port) if address.host == "localhost" else address


@dataclass(frozen=True, slots=True)
class Candidate:
    """A hub to try."""

    address: HubAddress  #: the address to connect to
    aliases: tuple[
        HubAddress, ...
    ] = ()  #: further addresses of it, which whitelist or blacklist may contain


@dataclass(frozen=True)
class HubView:
    """What we know about one hub and the other gateways on it; without a connection, the last known state."""

    connected: bool = False  #: whether we are connected to it
    hub_name: str = ""  #: its name; empty if we were never connected
    hub_uri: str = ""  #: its address; empty likewise
    host: str = ""  #: our address for the gateways on it; empty likewise
    listed: frozenset[str] = (
        frozenset()
    )  #: unique names of all gateways that the hub lists as alive, except ourselves
    #: unique names of all gateways that count as present: the listed ones, and some that were listed until recently
    names: frozenset[str] = frozenset()
    #: those of them concerned by our rules or their requests
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    namespaces: frozenset[str] = frozenset()  #: robot namespaces known to the hub


class Presence:
    """Tracks which gateways count as present, including some that the hub no longer lists.

    A gateway that deregisters is removed immediately. One that expires on the hub is removed immediately too, unless
    we have open links to it: it, or its connection to the hub, may just be slow, so it is retained for `LINKED_GRACE`.
    A restarted hub does not know any gateway yet, so those registered before are retained for `RESTART_GRACE`, and for
    another `LINKED_GRACE` if links are open. All times are monotonic [s].
    """

    LINKED_GRACE = 6.0
    RESTART_GRACE = 5.0

    def __init__(self) -> None:
        self.listed: set[str] = set()
        # For each gateway, until when it is retained without links, and until when with links.
        self._retained: dict[str, tuple[float, float]] = {}
        self._names: frozenset[str] = frozenset()

    @property
    def names(self) -> frozenset[str]:
        """All present gateways; the same object as long as the set does not change."""
        names = frozenset((*self.listed, *self._retained))
        if names != self._names:
            self._names = names
        return self._names

    @property
    def waiting(self) -> bool:
        """Whether any gateway is only retained, so that `settle` must be called again."""
        return bool(self._retained)

    def start(self, listed: Collection[str], now: float) -> None:
        """Starts with the list of a hub to which we have just connected."""
        alone = now + self.RESTART_GRACE
        # Also those retained already: without a hub, they could not register again.
        for name in self.names - set(listed):
            self._retained[name] = (alone, alone + self.LINKED_GRACE)
        self.listed = set(listed)
        self._drop(self.listed)

    def join(self, name: str) -> None:
        """Records that a gateway has registered."""
        self.listed.add(name)
        self._drop((name,))

    def leave(self, name: str) -> None:
        """Records that a gateway has deregistered."""
        self.listed.discard(name)
        self._drop((name,))

    def expire(self, name: str, now: float) -> None:
        """Records that a gateway has missed its heartbeats on the hub."""
        if name in self.listed:
            self.listed.discard(name)
            self._retained[name] = (now, now + self.LINKED_GRACE)

    def settle(self, linked: Collection[str], now: float) -> bool:
        """Removes retained gateways whose grace period is over or whose links are down; returns if there were any."""
        over = [
            name
            for name, (alone, together) in self._retained.items()
            if now >= (together if name in linked else alone)
        ]
        self._drop(over)
        return bool(over)

    def _drop(self, names: Collection[str]) -> None:
        for name in names:
            self._retained.pop(name, None)
