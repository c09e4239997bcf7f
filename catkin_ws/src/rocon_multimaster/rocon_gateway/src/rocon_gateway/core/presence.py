"""Where a hub is, how its keys are called, and who on it counts as present."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from rocon_gateway.core.situation import Remote
from rocon_hub_protocol.core.address import HubAddress, address_from_uri
from rocon_hub_protocol.core.code import Code, HubError


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
    """A hub to try."""

    address: HubAddress  #: where to dial
    aliases: tuple[HubAddress, ...] = ()  #: more addresses of it, as lists of allowed and refused hubs may have them


@dataclass(frozen=True)
class HubView:
    """What we know of one hub and of the others on it; without a connection, what we knew last."""

    connected: bool = False  #: whether we are on it now
    hub_name: str = ""  #: its name; empty when we were never there
    hub_uri: str = ""  #: its address; empty likewise
    host: str = ""  #: where the others on it reach us; empty likewise
    listed: frozenset[str] = frozenset()  #: unique names of all gateways that the hub says are alive, ourselves apart
    #: unique names of all that count as present: those, and some that it has just stopped listing
    names: frozenset[str] = frozenset()
    #: those of them that our rules or their requests concern
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    namespaces: frozenset[str] = frozenset()  #: of all robots that it knows


class Presence:
    """Which gateways count as present when the hub no longer lists them.

    A gateway that deregisters is gone at once. One that the hub merely stopped hearing of is gone at once
    too, unless our links to it still stand: then it, or its way to the hub, may only be slow, and it stays for
    `LINKED_GRACE`. A hub that was restarted knows no gateway yet, so those that were registered before stay for
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
        """Another gateway is registered."""
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
