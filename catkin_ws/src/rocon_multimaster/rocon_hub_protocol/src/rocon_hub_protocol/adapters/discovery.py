"""Hubs that announce themselves by mDNS, looked for as long as we need one."""

import hashlib
import logging
import os
import random
import threading
import time
from collections.abc import Callable
from ipaddress import IPv4Interface
from pathlib import Path
from typing import Any

from rocon_hub_protocol.core.sighting import SERVICE, Sighting

REOPEN = 5.0
"""Time between two looks at whether this machine's addresses have changed [s]; mDNS is heard on those of the start."""

RESOLVE = 3000
"""For how long an announced hub may keep its address to itself [ms]."""

MOST_ASKED = 8
"""Hubs that are asked for their address at once. An announcement of ours has it, and waits for none of these."""

MOST_SIGHTINGS, MOST_ADDRESSES = 1024, 8
"""Announced hubs that are remembered, and addresses of each; of more hubs any is forgotten."""


def own_interfaces() -> frozenset[IPv4Interface]:
    """Returns this machine's IPv4 addresses with their networks, the loopback's included."""
    import ifaddr  # costs nothing for gateways with a configured hub

    return frozenset(
        IPv4Interface(f"{address.ip}/{address.network_prefix}")
        for adapter in ifaddr.get_adapters()
        for address in adapter.ips
        if address.is_IPv4
    )


def network_stack() -> str:
    """Returns a text that only programs share that reach each other by the loopback: same boot, same namespace."""
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    namespace = os.stat("/proc/self/ns/net").st_ino
    return hashlib.sha256(f"{boot} {namespace}".encode()).hexdigest()[:16]


class Discovery:
    """Knows which hubs announce themselves. `sightings` and `rest` are for one thread.

    Args:
        on_change: called, from a thread of zeroconf's, when there are more or fewer.
    """

    def __init__(self, on_change: Callable[[], object]) -> None:
        self._on_change = on_change
        self._lock = threading.Lock()
        self._sightings: dict[str, Sighting] = {}
        self._asking = threading.Semaphore(MOST_ASKED)
        self._zeroconf: Any = None
        self._question: Any = None
        self._next_look = 0.0
        self.stack = network_stack()
        self.interfaces: frozenset[IPv4Interface] = frozenset()

    def sightings(self) -> list[Sighting]:
        """Returns the hubs seen since the search began, which it does with the first call after `rest`.

        Raises:
            OSError: this machine cannot listen to mDNS now.
        """
        if time.monotonic() >= self._next_look:
            self._next_look = time.monotonic() + REOPEN
            interfaces = own_interfaces()
            if interfaces != self.interfaces or self._zeroconf is None:
                self._close()
                self.interfaces = interfaces
                self._open()
        with self._lock:
            return sorted(self._sightings.values())

    def rest(self) -> None:
        """Ends the search until it is needed again, so that a gateway on a hub costs nothing for it."""
        self._close()
        self._next_look = 0.0

    def _open(self) -> None:
        import zeroconf  # costs 0.1 s and 8 MB, so only for gateways that look for a hub

        logging.getLogger("zeroconf").setLevel(logging.ERROR)
        self._zeroconf = zeroconf.Zeroconf(
            [str(one.ip) for one in sorted(self.interfaces)], ip_version=zeroconf.IPVersion.V4Only
        )
        # Answers to all: those to the asker alone may reach another program of this machine that shares the port.
        self._question = zeroconf.DNSQuestionType.QM
        zeroconf.ServiceBrowser(self._zeroconf, SERVICE, handlers=[self._take], question_type=self._question)

    def _close(self) -> None:
        if self._zeroconf is not None:
            close_zeroconf(self._zeroconf)
        self._zeroconf = None
        with self._lock:
            self._sightings.clear()

    def _take(self, zeroconf: Any, service_type: str, name: str, state_change: Any) -> None:
        from zeroconf import ServiceInfo

        info = ServiceInfo(service_type, name)
        if state_change.name == "Removed":
            self._keep(zeroconf, name, None)
        elif info.load_from_cache(zeroconf):
            self._keep(zeroconf, name, _sighting(info))
        elif self._asking.acquire(blocking=False):
            # In a thread of its own: announcements wait for this one, and who never answers must hold none of them up.
            threading.Thread(target=self._ask, args=(zeroconf, info), name="hub address", daemon=True).start()

    def _ask(self, zeroconf: Any, info: Any) -> None:
        try:
            if info.request(zeroconf, RESOLVE, self._question):
                self._keep(zeroconf, info.name, _sighting(info))
        except OSError:
            return  # it is closed, or the network is gone
        finally:
            self._asking.release()

    def _keep(self, zeroconf: Any, name: str, sighting: Sighting | None) -> None:
        with self._lock:
            if sighting is None:
                self._sightings.pop(name, None)
            elif zeroconf is self._zeroconf:
                self._sightings[name] = sighting
                if len(self._sightings) > MOST_SIGHTINGS:
                    del self._sightings[random.choice(list(self._sightings))]
        self._on_change()


def close_zeroconf(instance: Any) -> None:
    """Ends a ``zeroconf.Zeroconf`` with its event loop, which it leaves open: at exit that can be a stack trace."""
    instance.close()
    if instance.loop is not None and not instance.loop.is_running():
        instance.loop.close()


def _sighting(info: Any) -> Sighting | None:
    """Returns what an announcement says, None if it names no address and port."""
    if not info.port:
        return None
    import zeroconf

    addresses = tuple(info.parsed_addresses(zeroconf.IPVersion.V4Only))[:MOST_ADDRESSES]
    stack = (info.properties.get(b"stack") or b"").decode(errors="replace")
    tls = info.properties.get(b"tls") == b"1"
    return Sighting(info.name.removesuffix(f".{SERVICE}"), info.port, addresses, stack, tls) if addresses else None
