"""The certificates of a fleet: who has one that its authority signed belongs to it, and nobody else does."""

import errno
import os
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tcpros.core.error import CertificateError

VARIABLE = "ROCON_TLS_DIRECTORY"

NO_TLS = "it speaks no TLS"

CERTIFICATE, KEY, AUTHORITY = "tls.crt", "tls.key", "ca.crt"
"""The files in that directory, all PEM: our certificate, its key without a passphrase, and the fleet's authority."""

_STRANGE = ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "UNEXPECTED_MESSAGE", "RECORD_LAYER_FAILURE")
"""What OpenSSL calls bytes that are none of TLS."""


class TlsError(OSError):
    """A connection that TLS does not let be; `strerror` is one sentence for people."""

    def __init__(self, reason: str) -> None:
        super().__init__(errno.EPROTO, f"TLS: {reason}")


@dataclass(frozen=True)
class Certificates:
    """What a gateway or hub of a fleet needs for TLS. TLS 1.3 only, both sides show a certificate.

    Names in certificates are not compared with anything: addresses of robots change, and gateways are distinguished on
    the hub. A certificate says that its bearer is of the fleet.
    """

    directory: Path  #: where the files are
    server: ssl.SSLContext  #: for connections that others open
    client: ssl.SSLContext  #: for those that we open

    def fault(self) -> str:
        """Returns why others of the fleet will not accept our own certificate now; "" if they will."""
        to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
        ends = [
            self.client.wrap_bio(to_client, to_server),
            self.server.wrap_bio(to_server, to_client, server_side=True),
        ]
        for end in (*ends, *ends):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLCertVerificationError as error:
                return error.verify_message
            except ssl.SSLError as error:
                return reason_of(error)
        return ""

    def refusal(self, host: str, port: int, timeout: float) -> ssl.SSLError | None:
        """Returns why a server and we do not come together; None if we do, or it does not answer as TLS has it.

        We say nothing after the handshake, in which a server of TLS 1.3 has not looked at our certificate yet.
        """
        try:
            with socket.create_connection((host, port), timeout) as sock, self.client.wrap_socket(sock) as wrapped:
                wrapped.recv(1)
        except ssl.SSLEOFError:
            return None
        except ssl.SSLError as error:
            return error
        except OSError:
            return None
        return None


def certificates_from(path: str, environment: Mapping[str, str] = os.environ) -> Certificates | None:
    """Returns the certificates in the directory at `path`, else in the one that the environment names; else None.

    Raises:
        CertificateError: files are missing, cannot be read or do not belong together.
    """
    path = path or environment.get(VARIABLE, "")
    if not path:
        return None
    directory = Path(path).expanduser().absolute()
    try:
        contexts = [_context(side, directory) for side in (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT)]
    except OSError as error:
        raise CertificateError(f"the TLS certificates in {directory} cannot be used: {_said(error)}") from None
    contexts[0].num_tickets = 0  # type: ignore[attr-defined]  # sessions are not resumed
    return Certificates(directory, *contexts)


def _context(side: int, directory: Path) -> ssl.SSLContext:
    for name in (CERTIFICATE, KEY, AUTHORITY):
        (directory / name).open("rb").close()  # OpenSSL does not say which one is missing
    context = ssl.SSLContext(side)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname = False
    context.verify_mode = ssl.CERT_REQUIRED
    # A passphrase would be asked for on the terminal.
    context.load_cert_chain(directory / CERTIFICATE, directory / KEY, password="")
    # This authority and no other: not those that the system trusts.
    context.load_verify_locations(directory / AUTHORITY)
    return context


def _said(error: OSError) -> str:
    if isinstance(error, ssl.SSLError):
        return reason_of(error)
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)


def reason_of(error: ssl.SSLError) -> str:
    """Returns what became of a handshake or connection, one sentence about the peer."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not good: {error.verify_message}"
    reason = error.reason or str(error)
    if reason in _STRANGE:
        return NO_TLS
    _, is_alert, alert = reason.partition("_ALERT_")
    if is_alert:
        return f"it refuses our certificate: {alert.replace('_', ' ').lower()}"
    return reason.replace("_", " ").lower()


def speaks_tls(host: str, port: int, timeout: float) -> bool:
    """Tells whether a server begins TLS; asked where one that should not has ended our connection. Proves nothing."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    try:
        with socket.create_connection((host, port), timeout) as sock, context.wrap_socket(sock):
            return True
    except ssl.SSLError as error:
        return "_ALERT_" in (error.reason or "")
    except OSError:
        return False


def speaks_plainly(host: str, port: int, timeout: float) -> bool:
    """Tells whether a server answers as a Redis without TLS; asked where one did not begin TLS."""
    try:
        with socket.create_connection((host, port), timeout) as sock:
            sock.sendall(b"PING\r\n")
            return sock.recv(1) in (b"+", b"-")
    except OSError:
        return False
