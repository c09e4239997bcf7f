"""Clients of a hub's Redis, plain or with TLS."""

import socket
import ssl
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import redis

from rocon_hub_protocol.core.address import HubAddress
from rocon_hub_protocol.core.code import Code, HubError
from tcpros.adapters.tls import NO_TLS, VARIABLE, Certificates, reason_of, speaks_plainly, speaks_tls

Cause = TypeVar("Cause", bound=BaseException)

TIMEOUT = 2.0
"""Within which a hub must have answered [s]."""


@dataclass(frozen=True)
class Access:
    """What a hub may ask for.

    Attributes:
        password: what its Redis wants to hear; None for nothing. Not shown by repr.
        certificates: for TLS; None for none.
    """

    password: str | None = field(default=None, repr=False)
    certificates: Certificates | None = None


OPEN = Access()
"""To hubs that ask for nothing."""


class TlsConnection(redis.Connection):
    """A connection with TLS.

    redis' own makes a context for each that also believes every authority that the system trusts.
    """

    def __init__(self, context: ssl.SSLContext, **settings: Any) -> None:
        super().__init__(**settings)
        self._context = context

    def _connect(self) -> socket.socket:
        sock = super()._connect()
        try:
            return self._context.wrap_socket(sock)
        except OSError:
            sock.close()
            raise


def redis_client(address: HubAddress, access: Access, encoding_errors: str = "replace") -> redis.Redis:
    """Returns a client that has not connected yet.

    Args:
        address: the hub.
        access: what to say to it.
        encoding_errors: what becomes of what is no text. If replaced, it is no JSON either, and counts as not written.
    """
    kind: dict[str, Any] = {}
    if access.certificates:
        kind = {"connection_class": TlsConnection, "context": access.certificates.client}
    pool = redis.ConnectionPool(
        host=address.host,
        port=address.port,
        password=access.password,
        socket_timeout=TIMEOUT,
        socket_connect_timeout=TIMEOUT,
        socket_keepalive=True,
        decode_responses=True,
        encoding_errors=encoding_errors,
        **kind,
    )
    return redis.Redis(connection_pool=pool)


def unreachable(address: HubAddress, access: Access, error: Exception) -> HubError:
    """Returns what to raise when a hub has not answered: 14 if TLS is why, else 12."""
    if access.certificates is None:
        if not _is_refused(error) and not isinstance(error, redis.TimeoutError) and _speaks(speaks_tls, address):
            return needs_certificate(address)
        reason = ""
    else:
        reason = _tls_reason(address, access.certificates, error)
    if reason:
        return HubError(Code.HUB_CONNECTION_FAILED, f"the hub at {address}: {reason}")
    return HubError(Code.HUB_CONNECTION_UNRESOLVABLE, f"no hub at {address}: {error}")


def needs_certificate(address: HubAddress) -> HubError:
    """Returns what to raise where a hub speaks TLS and we do not."""
    text = f"the hub at {address} speaks TLS only: set {VARIABLE} to a directory with a certificate of its fleet"
    return HubError(Code.HUB_CONNECTION_FAILED, text)


def _tls_reason(address: HubAddress, certificates: Certificates, error: Exception) -> str:
    if _is_refused(error):
        return ""
    found = _cause(error, ssl.SSLError)
    if isinstance(found, ssl.SSLEOFError) or (found is None and _cause(error, TimeoutError) is None):
        # Who will not have us closes at once, and what we were just saying may have ended in that.
        found = certificates.refusal(address.host, address.port, TIMEOUT)
    if found is None and not _speaks(speaks_plainly, address):
        return ""
    if found is None or NO_TLS in reason_of(found):
        return f"{NO_TLS}, but we have a certificate ({VARIABLE}): give it one too, or take ours away"
    return f"TLS: {reason_of(found)}"


def _speaks(test: Callable[[str, int, float], bool], address: HubAddress) -> bool:
    return test(address.host, address.port, TIMEOUT)


def _is_refused(error: BaseException) -> bool:
    return _cause(error, ConnectionRefusedError) is not None


def _cause(error: BaseException | None, kind: type[Cause]) -> Cause | None:
    """Returns the error of this kind that led to another one; the client library wraps them."""
    while error is not None and not isinstance(error, kind):
        error = error.__context__
    return error
