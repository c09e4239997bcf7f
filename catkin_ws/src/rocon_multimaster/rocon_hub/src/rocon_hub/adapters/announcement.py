"""The hub's announcement by mDNS, as `_ros-multimaster-hub._tcp`."""

import socket

import zeroconf

SERVICE = "_ros-multimaster-hub._tcp.local."


class Announcement:
    """Announces the hub from its making until `close`.

    Args:
        name: the hub's name.
        port: its port.
        host: this machine's address, as others reach it.
    """

    def __init__(self, name: str, port: int, host: str) -> None:
        self._zeroconf = zeroconf.Zeroconf()
        self._service = zeroconf.ServiceInfo(
            SERVICE, f"{name.replace('.', ' ')}.{SERVICE}", port=port, addresses=[socket.inet_aton(_ipv4(host))]
        )
        self._zeroconf.register_service(self._service, allow_name_change=True)

    def close(self) -> None:
        """Takes the announcement back."""
        self._zeroconf.unregister_service(self._service)
        self._zeroconf.close()


def _ipv4(host: str) -> str:
    return socket.getaddrinfo(host, None, socket.AF_INET)[0][4][0]
