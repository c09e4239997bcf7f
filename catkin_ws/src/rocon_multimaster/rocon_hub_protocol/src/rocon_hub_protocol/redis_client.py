"""Clients for a hub's Redis, with or without TLS and password."""

import socket
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import redis

from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.password import FILE_VARIABLE, Password
from tcpros.tls import NO_TLS, VARIABLE, Certificates, reason_of, speaks_plainly, speaks_tls

Cause = TypeVar("Cause", bound=BaseException)

LONGEST_LINE = 512
"""Maximum length of a hub's line during the proof [bytes]."""

TIMEOUT = 2.0
"""Timeout for a hub's answer [s]."""

SEGMENT = 500
"""Size of TCP segments between gateways and hub [bytes]: it fits the smallest MTU of IPv4, 576.

So records also arrive on a path that swallows full packets (VPN, tunnel). They are small and rare, so the additional
headers do not matter.
"""

TCP_OPTIONS = {socket.TCP_MAXSEG: SEGMENT}
"""Options of a connection to a hub. redis-py sets `socket_keepalive_options` of any name before it connects."""

PROOF_TIMEOUT = 5.0
"""Timeout for each line of its proof [s]; longer, as proofs take CPU time and a thousand gateways may come at once."""


@dataclass(frozen=True)
class Access:
    """Credentials for a hub."""

    #: the password to prove; None for none. Not shown by repr.
    password: Password | None = field(default=None, repr=False)
    certificates: Certificates | None = None  #: for TLS; None for none


OPEN = Access()
"""Access to hubs without authentication."""


class NotOurHubError(redis.AuthenticationError):
    """The passwords differ, or only one side has one; the text says which."""


class HubConnection(redis.Connection):
    """A connection to a hub, with TLS and the proof of the password before the Redis protocol.

    The TLS support of redis-py is not used: it creates a context for each connection and trusts the system's
    authorities too.
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
    """Runs the mutual proof of the password with the hub at the other end. Changes the socket's timeout.

    Raises:
        NotOurHubError: one side does not know the password, or the peer is not a hub with a password.
        OSError: the hub does not answer in time.
    """
    # Takes 2 MB, so imported only with a password.
    from rocon_hub_protocol.admission import BUSY, REFUSED, GatewaySide
    from rocon_hub_protocol.cpace import ProofError

    side = GatewaySide(password)
    sock.sendall(side.first)
    line = _line(sock)
    if line.startswith(b"-NOAUTH"):
        raise NotOurHubError("asks for the password in clear, which we never send: update it")
    if line.startswith(b"-"):
        raise NotOurHubError(
            f"has no password, but we have one: it is no hub of ours, or it needs ours ({FILE_VARIABLE} there)"
        )
    try:
        sock.sendall(side.prove(line))
        line = _line(sock)
        if line == REFUSED:
            raise NotOurHubError(
                f"wants another password than ours (from {FILE_VARIABLE} or hub_password_file)"
            )
        if line == BUSY:
            raise NotOurHubError("checks few proofs from this host, as too many have failed")
        known = side.accepts(line)
    except ProofError as error:
        raise NotOurHubError(f"is no hub of ours: {error}") from None
    if not known:
        raise NotOurHubError("does not know our password: it is no hub of ours")


def _line(sock: socket.socket) -> bytes:
    # The hub sends one line, then waits for our answer.
    line, deadline = b"", time.monotonic() + PROOF_TIMEOUT
    while not line.endswith(b"\n"):
        # One deadline for the whole line; otherwise a peer that sends single bytes could block us for an hour.
        sock.settimeout(max(0.001, deadline - time.monotonic()))
        part = sock.recv(LONGEST_LINE - len(line))
        if not part:  # closed, or the line is too long
            raise ConnectionError("Connection closed by server.")
        line += part
    return line


def redis_client(address: HubAddress, access: Access) -> redis.Redis:
    """Returns a client that is not connected yet.

    Args:
        address: the hub.
        access: our credentials.
    """
    pool = redis.ConnectionPool(
        connection_class=HubConnection,
        access=access,
        host=address.host,
        port=address.port,
        socket_timeout=TIMEOUT,
        socket_connect_timeout=TIMEOUT,
        socket_keepalive=True,
        socket_keepalive_options=TCP_OPTIONS,
        decode_responses=True,
        encoding_errors="replace",  # invalid UTF-8 then is invalid JSON too and is ignored
    )
    return redis.Redis(connection_pool=pool)


def unreachable(address: HubAddress, access: Access, error: Exception) -> HubError:
    """Returns the error for a hub that has not answered: 14 if TLS is the reason, else 12."""
    if access.certificates is None:
        if (
            not _is_refused(error)
            and not isinstance(error, redis.TimeoutError)
            and _speaks(speaks_tls, address)
        ):
            return needs_certificate(address)
        reason = ""
    else:
        reason = _tls_reason(address, access.certificates, error)
    if reason:
        return HubError(Code.HUB_CONNECTION_FAILED, f"the hub at {address}: {reason}")
    return HubError(Code.HUB_CONNECTION_UNRESOLVABLE, f"no hub at {address}: {error}")


def needs_certificate(address: HubAddress) -> HubError:
    """Returns the error for a hub that requires TLS when we have no certificate."""
    text = f"the hub at {address} speaks TLS only: set {VARIABLE} to a directory with a certificate of its fleet"
    return HubError(Code.HUB_CONNECTION_FAILED, text)


def _tls_reason(address: HubAddress, certificates: Certificates, error: Exception) -> str:
    if _is_refused(error):
        return ""
    found = _cause(error, ssl.SSLError)
    if isinstance(found, ssl.SSLEOFError) or (
        found is None and _cause(error, TimeoutError) is None
    ):
        # A hub that rejects us closes at once, so our own send may have failed before its alert arrived.
        found = certificates.refusal(address.host, address.port, TIMEOUT)
    if found is None and not _speaks(speaks_plainly, address):
        return ""
    if found is None or NO_TLS in reason_of(found):
        return f"{NO_TLS}, but we have a certificate ({VARIABLE}): it is no hub of ours, or it needs one too"
    return f"TLS: {reason_of(found)}"


def _speaks(test: Callable[[str, int, float], bool], address: HubAddress) -> bool:
    return test(address.host, address.port, TIMEOUT)


def _is_refused(error: BaseException) -> bool:
    return _cause(error, ConnectionRefusedError) is not None


def _cause(error: BaseException | None, kind: type[Cause]) -> Cause | None:
    """Returns the underlying error of this kind, if any; the client library wraps errors."""
    while error is not None and not isinstance(error, kind):
        error = error.__context__
    return error
