"""A hub that announces itself on the network, and under which of its addresses we reach it."""

from collections.abc import Collection
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface

from rocon_hub_protocol.core.address import HubAddress

SERVICE = "_ros-multimaster-hub._tcp.local."
"""The type of a hub's announcement by mDNS; rocon's."""

LOOPBACK = "127.0.0.1"

LABEL_LENGTH = 63
"""Bytes that an instance name of DNS may have."""


@dataclass(frozen=True, slots=True, order=True)
class Sighting:
    """What a hub's announcement says."""

    name: str  #: the announcement's instance name, for people; the hub's own name is in its Redis
    port: int  #: the hub's port
    addresses: tuple[str, ...]  #: its machine's IPv4 addresses
    stack: str = ""  #: a text that only programs of the same machine (and network namespace) share; empty if unknown
    tls: bool = False  #: whether it says that it speaks TLS

    @property
    def hubs(self) -> tuple[HubAddress, ...]:
        """All addresses, as they may stand in a list of allowed or refused hubs."""
        return tuple(self._at(address) for address in self.addresses)

    def is_local(self, own: Collection[IPv4Interface], stack: str) -> bool:
        """Tells whether the hub runs on this machine.

        Args:
            own: this machine's addresses. They decide only if the announcement names no stack: addresses such as
                that of `docker0` are the same on many machines.
            stack: this machine's.
        """
        if self.stack:
            return self.stack == stack
        return bool({str(one.ip) for one in own} & set(self.addresses))

    def ways(self, own: Collection[IPv4Interface], stack: str) -> tuple[HubAddress, ...]:
        """Returns where to dial, best first: the loopback for a hub on this machine, else addresses in a network of
        ours before others. Empty if the hub cannot be reached from here.
        """
        if self.is_local(own, stack):
            return (self._at(LOOPBACK),)
        mine = {one.ip for one in own}
        far = [one for one in map(IPv4Address, self.addresses) if not one.is_loopback and one not in mine]
        far.sort(key=lambda address: not any(address in one.network for one in own))
        return tuple(self._at(str(address)) for address in far)

    def _at(self, address: str) -> HubAddress:
        return HubAddress(address, self.port, self.tls)


def instance_name(hub: str, host: str, port: int) -> str:
    """Returns a name for a hub's announcement that no other hub on the network has: `Pioneer Hub (base:6380)`."""
    place = f" ({host}:{port})".replace(".", "-")
    room = LABEL_LENGTH - len(place.encode())
    return hub.replace(".", " ").encode()[: max(room, 1)].decode(errors="ignore") + place
