"""Clients of a hub's Redis, plain or with TLS, with or without a password."""

import socket
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import redis

from rocon_hub_protocol.adapters.password import FILE_VARIABLE, Password
from rocon_hub_protocol.core.address import HubAddress
from rocon_hub_protocol.core.code import Code, HubError
from tcpros.adapters.tls import NO_TLS, VARIABLE, Certificates, reason_of, speaks_plainly, speaks_tls

Cause = TypeVar("Cause", bound=BaseException)

LONGEST_LINE = 512
"""A hub's line during the proof is shorter than this [bytes]."""

TIMEOUT = 2.0
"""Within which a hub must have answered [s]."""

PROOF_TIMEOUT = 5.0
"""The same for each line of its proof [s]: a thousand gateways may come at once, and each costs a hub some work."""


@dataclass(frozen=True)
class Access:
    """What a hub may ask for."""

    #: what it wants a proof of; None for nothing. Not shown by repr.
    password: Password | None = field(default=None, repr=False)
    certificates: Certificates | None = None  #: for TLS; None for none


OPEN = Access()
"""To hubs that ask for nothing."""


class NotOurHubError(redis.AuthenticationError):
    """The other side and we do not have the same password, or only one of us has any; the text says which."""


class HubConnection(redis.Connection):
    """A connection to a hub: TLS and the proof of the password come before Redis.

    redis' own TLS makes a context for each connection, which also trusts every authority that the system trusts.
    """

    def __init__(self, access: Access, **settings: Any) -> None:
        super().__init__(**settings)
        self._access = access

    def _connect(self) -> socket.socket:
        sock = super()._connect()
        try:
            if self._access.certificates:
                sock = self._access.certificates.client.wrap_socket(sock)
            if self._access.password:
                prove(sock, self._access.password())
                sock.settimeout(self.socket_timeout)
        except BaseException:
            sock.close()
            raise
        return sock


def prove(sock: socket.socket, password: str) -> None:
    """Has us and the hub at the other end prove to each other that we know the password.

    Raises:
        NotOurHubError: one of us does not know it, or it is no hub with a password.
        OSError: the hub does not answer, or too slowly. The socket's time-out is another one afterwards.
    """
    # Costs 2 MB, so only for gateways with a password.
    from rocon_hub_protocol.core.admission import REFUSED, GatewaySide
    from rocon_hub_protocol.core.cpace import ProofError

    side = GatewaySide(password)
    sock.sendall(side.first)
    line = _line(sock)
    if line.startswith(b"-NOAUTH"):
        raise NotOurHubError("asks for the password in clear, which we never send: update it")
    if line.startswith(b"-"):
        raise NotOurHubError(f"has no password, but we have one: unset {FILE_VARIABLE} here or set it there")
    try:
        sock.sendall(side.prove(line))
        line = _line(sock)
        if line == REFUSED:
            raise NotOurHubError(f"wants another password than ours (from {FILE_VARIABLE} or hub_password_file)")
        known = side.accepts(line)
    except ProofError as error:
        raise NotOurHubError(f"is no hub of ours: {error}") from None
    if not known:
        raise NotOurHubError("does not know our password: it is no hub of ours")


def _line(sock: socket.socket) -> bytes:
    # The hub says one line, and then nothing until it is answered.
    line, deadline = b"", time.monotonic() + PROOF_TIMEOUT
    while not line.endswith(b"\n"):
        # Of the whole line: one byte after the other would keep us for an hour.
        sock.settimeout(max(0.001, deadline - time.monotonic()))
        part = sock.recv(LONGEST_LINE - len(line))
        if not part:  # closed, or too long for a line of ours
            raise ConnectionError("Connection closed by server.")
        line += part
    return line


def redis_client(address: HubAddress, access: Access) -> redis.Redis:
    """Returns a client that has not connected yet.

    Args:
        address: the hub.
        access: what it may ask for.
    """
    pool = redis.ConnectionPool(
        connection_class=HubConnection,
        access=access,
        host=address.host,
        port=address.port,
        socket_timeout=TIMEOUT,
        socket_connect_timeout=TIMEOUT,
        socket_keepalive=True,
        decode_responses=True,
        encoding_errors="replace",  # what is no text is no JSON then either, and counts as not written
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
