"""The address of a hub."""

import re
from dataclasses import dataclass, field

from rocon_hub_protocol.code import Code, HubError

DEFAULT_PORT = 6380

TLS_SCHEME = "rediss"
"""URI scheme of a hub with TLS, as used by Redis clients."""


@dataclass(frozen=True, slots=True)
class HubAddress:
    """Where a hub's Redis listens."""

    host: str  #: host name or IP address
    port: int  #: its port
    tls: bool = field(
        default=False, compare=False
    )  #: whether it is known to use TLS; ignored in comparisons

    def __str__(self) -> str:
        return f"{TLS_SCHEME if self.tls else 'http'}://{self.host}:{self.port}"


def address_from_uri(uri: str) -> HubAddress:
    """Parses `http://host:port`, `host:port` or `host`; `rediss://host:port` for a hub with TLS.

    Raises:
        HubError: 12 for any other text.
    """
    found = re.fullmatch(
        r"(?:([a-z]+)://)?(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?/?", uri.strip()
    )
    if not found:
        raise HubError(
            Code.HUB_CONNECTION_UNRESOLVABLE,
            f"'{uri}' is not a hub's address; write http://host:port",
        )
    port = int(found[3] or DEFAULT_PORT)
    if not 0 < port < 65536:
        raise HubError(Code.HUB_CONNECTION_UNRESOLVABLE, f"'{uri}': there is no port {port}")
    return HubAddress(found[2].strip("[]"), port, found[1] == TLS_SCHEME)
