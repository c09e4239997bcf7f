"""Slows down hosts whose clients fail to prove the hub's password. Times are monotonic [s]."""

import asyncio
import ipaddress
import time
from dataclasses import dataclass, field

FIRST_DELAY, LONGEST_DELAY = 0.1, 1.0
"""Pause after a host's first failure, which doubles with each further one, and its limit [s]."""

MAX_WAITING = 4
"""Maximum number of a host's proofs that wait for their turn; a gateway waits up to 5 s for its answer."""

MAX_HOSTS = 1024
"""Maximum number of failing hosts that are remembered; beyond it, the one that failed longest ago is forgotten."""

MEMORY = 60.0
"""Time without a failure after which a host is forgotten, and between two reports on it [s]."""


@dataclass(eq=False)
class FailingHost:
    """A host from which proofs have failed."""

    failures: int = 0  #: number of failures since it was last forgotten
    unreported: int = 0  #: number of failures since the last report
    ready_at: float = 0.0  #: when its next proof is checked
    waiting: int = 0  #: number of proofs that wait
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)  #: held by the proof that is next

    def fail(self, now: float) -> None:
        """Counts a failure and sets the pause before the next proof."""
        delay = FIRST_DELAY * 2.0 ** min(self.failures, 16)
        self.ready_at = now + min(delay, LONGEST_DELAY)
        self.failures += 1
        self.unreported += 1

    async def wait(self) -> bool:
        """Waits until the next proof of this host may be checked; returns False at once if too many others wait."""
        if self.waiting >= MAX_WAITING:
            return False
        self.waiting += 1
        try:
            async with self.turn:
                await asyncio.sleep(self.ready_at - time.monotonic())
        finally:
            self.waiting -= 1
        return True


class FailingHosts:
    """The hosts from which proofs have failed lately."""

    def __init__(self) -> None:
        self._hosts: dict[str, FailingHost] = {}

    def get(self, address: str) -> FailingHost | None:
        """Returns the host at this address if proofs from it have failed."""
        return self._hosts.get(host_of(address))

    def fail(self, address: str, now: float) -> bool:
        """Counts a failure; returns whether it is the first one of this host."""
        name = host_of(address)
        host = self._hosts.pop(name, None)
        is_first = host is None
        host = host or FailingHost()
        self._hosts[name] = host  # the last one in the order
        host.fail(now)
        if len(self._hosts) > MAX_HOSTS:
            del self._hosts[next(iter(self._hosts))]
        return is_first

    def report(self, address: str) -> int:
        """Returns the number of failures since the last report; forgets the host if there are none."""
        name = host_of(address)
        host = self._hosts.get(name)
        if host is None:
            return 0
        number, host.unreported = host.unreported, 0
        if not number and not host.waiting:
            del self._hosts[name]
        return number


def host_of(address: str) -> str:
    """Returns what counts as one host: an IPv4 address, or the 64 bits of an IPv6 network, which one host can have."""
    try:
        number = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(number, ipaddress.IPv4Address):
        return address
    return str(ipaddress.ip_network((number, 64), strict=False))
