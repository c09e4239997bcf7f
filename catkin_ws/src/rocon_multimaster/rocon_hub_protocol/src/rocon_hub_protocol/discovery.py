"""Discovers hubs by mDNS while a hub is needed."""

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

from rocon_hub_protocol.sighting import SERVICE, Sighting

REOPEN = 5.0
"""Period of the check for changed addresses [s]; zeroconf only listens on the addresses present at its start."""

RESOLVE = 3000
"""Timeout for resolving the address of an announced hub [ms]."""

MOST_ASKED = 8
"""Maximum number of hubs resolved at once. Hubs of this project announce their address and need no resolving."""

MOST_SIGHTINGS, MOST_ADDRESSES = 1024, 8
"""Maximum number of remembered hubs, and of addresses for each; beyond it, a random hub is dropped."""


def own_interfaces() -> frozenset[IPv4Interface]:
    """Returns this machine's IPv4 addresses with their networks, including the loopback."""
    import ifaddr  # not needed by gateways with a configured hub

    return frozenset(
        IPv4Interface(f"{address.ip}/{address.network_prefix}")
        for adapter in ifaddr.get_adapters()
        for address in adapter.ips
        if address.is_IPv4
    )


def network_stack() -> str:
    """Returns an id shared by programs that reach each other over the loopback: same boot, same network namespace."""
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    namespace = os.stat("/proc/self/ns/net").st_ino
    return hashlib.sha256(f"{boot} {namespace}".encode()).hexdigest()[:16]


class Discovery:
    """Tracks announced hubs. `sightings` and `rest` must be called from one thread.

    Args:
        on_change: called from a zeroconf thread when the set of hubs changes.
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
        """Returns the hubs seen since the search began. The first call, and the first after `rest`, starts a search.

        Raises:
            OSError: this machine cannot listen for mDNS now.
        """
        if time.monotonic() >= self._next_look:
            self._next_look = time.monotonic() + REOPEN
            interfaces = own_interfaces()
            if interfaces != self.interfaces or self._zeroconf is None:
                self._close()
                self.interfaces = interfaces
                try:
                    self._open()
                except Exception:
                    # Half a search, such as one without its thread, would find nothing and never be opened again.
                    self._close()
                    raise
        with self._lock:
            return sorted(self._sightings.values())

    def rest(self) -> None:
        """Stops the search until the next call of `sightings`, so that it costs a gateway on a hub nothing."""
        self._close()
        self._next_look = 0.0

    def _open(self) -> None:
        import zeroconf  # takes 0.1 s and 8 MB, so imported only when searching

        logging.getLogger("zeroconf").setLevel(logging.ERROR)
        self._zeroconf = zeroconf.Zeroconf(
            [str(one.ip) for one in sorted(self.interfaces)], ip_version=zeroconf.IPVersion.V4Only
        )
        # Multicast answers: a unicast answer may reach another program on this machine that shares the port.
        self._question = zeroconf.DNSQuestionType.QM
        zeroconf.ServiceBrowser(
            self._zeroconf, SERVICE, handlers=[self._take], question_type=self._question
        )

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
            # In a separate thread, because this callback blocks further announcements and the hub may never answer.
            threading.Thread(
                target=self._ask, args=(zeroconf, info), name="hub address", daemon=True
            ).start()

    def _ask(self, zeroconf: Any, info: Any) -> None:
        try:
            if info.request(zeroconf, RESOLVE, self._question):
                self._keep(zeroconf, info.name, _sighting(info))
        except OSError:
            return  # zeroconf was closed, or the network is down
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
    """Closes a ``zeroconf.Zeroconf`` and its event loop, which it leaves open and can cause a stack trace at exit."""
    instance.close()
    if instance.loop is not None and not instance.loop.is_running():
        instance.loop.close()


def _sighting(info: Any) -> Sighting | None:
    """Returns the content of an announcement, None if it has no address or port."""
    if not info.port:
        return None
    import zeroconf

    addresses = tuple(info.parsed_addresses(zeroconf.IPVersion.V4Only))[:MOST_ADDRESSES]
    stack = (info.properties.get(b"stack") or b"").decode(errors="replace")
    tls = info.properties.get(b"tls") == b"1"
    return (
        Sighting(info.name.removesuffix(f".{SERVICE}"), info.port, addresses, stack, tls)
        if addresses
        else None
    )
