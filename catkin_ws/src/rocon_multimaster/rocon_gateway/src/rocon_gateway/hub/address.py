"""Finds the address under which other machines reach this one."""

import contextlib
import os
import socket

import rosgraph.network

from rocon_gateway.error import ConfigError


def own_address(towards: str) -> str:
    """Returns ROS_HOSTNAME or ROS_IP if set, otherwise the address of the interface that routes to host `towards`.

    A loopback setting is ignored if `towards` is another machine. It keeps a computer's own nodes private
    (docs/several-hosts.md), but other machines must still reach the gateway's relay.

    If the route is the loopback (a hub on this machine, or none), any other address of this machine is preferred. If
    there is none, the loopback address is returned.
    """
    named = os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP")
    if named and not (towards and _is_loopback(named)):
        return named
    if towards:
        with contextlib.suppress(OSError):
            address = _route(towards)
            if not _is_loopback(address):
                return address
    return named or rosgraph.network.get_local_address()


def interface_address(interface: str) -> str:
    """Returns the IPv4 address of a network interface of this machine, such as eth0.

    Raises:
        ConfigError: there is no such interface, or it has no address.
    """
    import ifaddr  # imported only if an interface is configured

    addresses = {
        adapter.name: [ip.ip for ip in adapter.ips if ip.is_IPv4]
        for adapter in ifaddr.get_adapters()
    }
    if not addresses.get(interface):
        known = ", ".join(sorted(name for name, own in addresses.items() if own))
        raise ConfigError(
            f"gateway: ~network_interface: no interface {interface!r} with an address here, only {known}"
        )
    return str(addresses[interface][0])


def _is_loopback(host: str) -> bool:
    # Names are not resolved: on Debian, a computer's own name resolves to 127.0.1.1, but only on that computer.
    return host.startswith("127.") or host in ("localhost", "::1")


def _route(host: str) -> str:
    family, kind, protocol, _, target = socket.getaddrinfo(host, 9, type=socket.SOCK_DGRAM)[0]
    # Connecting a datagram socket sends nothing; it only selects the route.
    with socket.socket(family, kind, protocol) as probe:
        probe.connect(target)
        return str(probe.getsockname()[0])
