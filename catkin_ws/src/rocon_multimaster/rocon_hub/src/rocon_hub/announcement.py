"""Announces the hub by mDNS as `_ros-multimaster-hub._tcp`."""

import logging
import socket
from ipaddress import IPv4Interface
from typing import Any

from rocon_hub.error import AnnouncementError
from rocon_hub_protocol.discovery import close_zeroconf, network_stack, own_interfaces
from rocon_hub_protocol.sighting import LOOPBACK, SERVICE, instance_name


class Announcement:
    """Announces the hub from the first `refresh` until `close`.

    Args:
        name: the hub's name.
        port: its port.
        everywhere: whether other machines may connect; otherwise the hub is announced on this machine only.
        tls: whether the hub speaks TLS.
    """

    def __init__(self, name: str, port: int, everywhere: bool, tls: bool) -> None:
        self._name, self._port, self._everywhere, self._tls = name, port, everywhere, tls
        self._zeroconf: Any = None
        self._interfaces: frozenset[IPv4Interface] = frozenset()

    def refresh(self) -> None:
        """Announces the hub under the current addresses of this machine, if they have changed.

        Raises:
            AnnouncementError: the announcement failed.
        """
        interfaces = own_interfaces()
        if interfaces == self._interfaces:
            return
        self.close()
        addresses = [str(one.ip) for one in sorted(interfaces)]
        try:
            self._announce(addresses if self._everywhere else [LOOPBACK])
        except (OSError, RuntimeError) as error:
            raise AnnouncementError(f"the hub is not announced by mDNS: {error}") from None
        self._interfaces = interfaces

    def _announce(self, addresses: list[str]) -> None:
        import zeroconf  # only for hubs that announce themselves

        logging.getLogger("zeroconf").setLevel(logging.ERROR)
        reachable = [address for address in addresses if not address.startswith("127.")] or [
            LOOPBACK
        ]
        instance = f"{instance_name(self._name, socket.gethostname(), self._port)}.{SERVICE}"
        try:
            service = zeroconf.ServiceInfo(
                SERVICE,
                instance,
                server=instance,  # required by Debian 13's zeroconf
                port=self._port,
                parsed_addresses=reachable,
                properties={
                    "name": self._name,
                    "stack": network_stack(),
                    **({"tls": "1"} if self._tls else {}),
                },
            )
            self._zeroconf = zeroconf.Zeroconf(addresses, ip_version=zeroconf.IPVersion.V4Only)
            # Not register_service: it rejects rocon's service type, which is longer than RFC 6763 allows.
            self._zeroconf.update_service(service)
        except zeroconf.Error as error:
            raise RuntimeError(str(error) or type(error).__name__) from None

    def close(self) -> None:
        """Withdraws the announcement."""
        if self._zeroconf is not None:
            close_zeroconf(self._zeroconf)
        self._zeroconf = None
