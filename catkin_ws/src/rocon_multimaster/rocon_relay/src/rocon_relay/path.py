"""Finds paths that swallow large packets, and the TCP segment size that passes nevertheless.

Where the MTU of a path (VPN, tunnel, mixed network cards) is smaller than the devices at its ends know, small packets
pass and full ones vanish. TCP does not notice: small messages flow, large ones never arrive.
"""

from collections.abc import Callable
from dataclasses import dataclass

from rocon_relay.connection import Address

SEGMENTS = (0, 1200, 500)
"""TCP segment sizes to try in turn [bytes]; 0 is the kernel's choice. They fit IPv6's and IPv4's smallest MTU."""

HEADERS = 40
"""Size of the IP and TCP headers in front of a segment [bytes]."""

FORGET = 600.0
"""How long a smaller segment size is kept before new links try the full one again [s]: the path may have changed."""

PROBE_TIMEOUT = 3.0
"""How long a full packet may take after the small one in front of it [s]. TCP sends it four times in that time."""

MARGIN = 256
"""How much longer than a segment a probe is, so that a full packet is part of it [bytes]."""

MAX_PROBE = 9216
"""Maximum size of a probe [bytes]: a jumbo frame."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The segment size for a link, and how sure we are that it must not be larger."""

    segment: int = 0  #: size of TCP segments [bytes]; 0 for the kernel's choice
    #: the largest size that a proof leaves: a full packet vanished while a smaller one arrived. 0 if none did; then
    #: the other gateway may only have been slow
    proved: int = 0

    @property
    def is_proved(self) -> bool:
        """Whether packets of the kernel's choice are known to vanish."""
        return self.proved > 0


FULL = Choice()
"""The kernel's choice."""


@dataclass(frozen=True, slots=True)
class _Path:
    choice: Choice
    since: float  #: when it was chosen [s]


class Paths:
    """The segment sizes for links to other gateways, by their relays' addresses.

    Args:
        clock: monotonic time [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._paths: dict[Address, _Path] = {}

    def choice(self, address: Address) -> Choice:
        """Returns the segment size for a new link."""
        path = self._paths.get(address)
        if path is not None and self._clock() > path.since + FORGET:
            del self._paths[address]
            path = None
        return path.choice if path else FULL

    def swallows(self, address: Address, segment: int, is_proved: bool) -> None:
        """Records that full packets vanish on a link with this segment size; the next link uses a smaller one.

        After the smallest size the full one is next. Reports of other sizes than the current one are out of date and
        ignored.

        Args:
            address: the other gateway's relay.
            segment: the segment size of the link [bytes].
            is_proved: whether a smaller packet has arrived; False if nothing has come, also not from a frozen gateway.
        """
        current = self.choice(address)
        if segment != current.segment:
            return
        following = SEGMENTS[(SEGMENTS.index(segment) + 1) % len(SEGMENTS)]
        if following:
            proved = following if is_proved else current.proved
            self._paths[address] = _Path(Choice(following, proved), self._clock())
        else:
            del self._paths[address]


def advice(choice: Choice) -> str:
    """Returns what links with smaller segments say about their path; "" for the kernel's choice."""
    if not choice.segment:
        return ""
    size = choice.segment + HEADERS
    if choice.proved == choice.segment:
        return (
            f"full packets do not arrive on this path, so its links send at most {size} bytes at once; "
            f"set the MTU of its devices (ip link set DEV mtu {size})"
        )
    if choice.is_proved:
        proved = choice.proved + HEADERS
        return (
            f"full packets do not arrive on this path; set the MTU of its devices (ip link set DEV mtu {proved}). "
            f"A TLS handshake took too long with {proved} bytes as well: the other gateway was busy, or these do not "
            f"arrive either, so its links send at most {size} bytes at once"
        )
    return (
        "a TLS handshake took too long: the other gateway was busy, or full packets do not arrive on this path. "
        f"In case of the latter, its links send at most {size} bytes at once"
    )
