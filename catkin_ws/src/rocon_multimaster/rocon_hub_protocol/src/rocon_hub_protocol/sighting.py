"""A hub discovered by mDNS, and the addresses under which it can be reached."""

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface

from rocon_hub_protocol.address import HubAddress

SERVICE = "_ros-multimaster-hub._tcp.local."
"""The mDNS service type of a hub, as in rocon."""

LOOPBACK = "127.0.0.1"

LABEL_LENGTH = 63
"""Maximum length of a DNS instance name [bytes]."""

HOST_LENGTH = 40
"""Maximum length of the host's name in it [bytes]; at least 14 bytes remain for the hub's."""


@dataclass(frozen=True, slots=True, order=True)
class Sighting:
    """The content of a hub's announcement."""

    name: str  #: the announcement's instance name, for display; the hub's own name is in its Redis
    port: int  #: the hub's port
    addresses: tuple[str, ...]  #: its machine's IPv4 addresses
    stack: str = ""  #: an id shared only by programs on the same machine (and network namespace); empty if unknown
    tls: bool = False  #: whether it announces TLS

    @property
    def hubs(self) -> tuple[HubAddress, ...]:
        """All addresses, in the form used in whitelist and blacklist."""
        return tuple(self._at(address) for address in self.addresses)

    def is_local(self, own: Collection[IPv4Interface], stack: str) -> bool:
        """Returns whether the hub runs on this machine.

        Args:
            own: this machine's addresses. They are used only if the announcement has no stack id, because addresses
                such as that of `docker0` are the same on many machines.
            stack: this machine's stack id.
        """
        if self.stack:
            return self.stack == stack
        return bool({str(one.ip) for one in own} & set(self.addresses))

    def ways(self, own: Collection[IPv4Interface], stack: str) -> tuple[HubAddress, ...]:
        """Returns the addresses to try, best first; empty if the hub cannot be reached from here.

        For a hub on this machine, this is the loopback. Otherwise addresses in one of our networks come first.
        """
        if self.is_local(own, stack):
            return (self._at(LOOPBACK),)
        mine = {one.ip for one in own}
        far = [
            one
            for one in map(IPv4Address, self.addresses)
            if not one.is_loopback and one not in mine
        ]
        far.sort(key=lambda address: not any(address in one.network for one in own))
        return tuple(self._at(str(address)) for address in far)

    def _at(self, address: str) -> HubAddress:
        return HubAddress(address, self.port, self.tls)


def instance_name(hub: str, host: str, port: int) -> str:
    """Returns an instance name unique on the network, such as `Pioneer Hub (base:6380)`, of at most `LABEL_LENGTH`.

    A long host name is cut, and a digest of it keeps the instance name unique.
    """
    host_bytes = host.encode(errors="replace")
    if len(host_bytes) > HOST_LENGTH:
        digest = hashlib.blake2s(host_bytes, digest_size=4).hexdigest()
        host = f"{host_bytes[: HOST_LENGTH - 9].decode(errors='ignore')}-{digest}"
    place = f" ({host}:{port})".replace(".", "-").encode(errors="replace").decode()
    room = LABEL_LENGTH - len(place.encode())
    return hub.replace(".", " ").encode()[:room].decode(errors="ignore") + place
