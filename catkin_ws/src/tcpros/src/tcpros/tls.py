"""TLS certificates of a fleet. A host is a member if it has a certificate signed by the fleet's authority."""

import errno
import os
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tcpros.error import CertificateError

VARIABLE = "ROCON_TLS_DIRECTORY"

NO_TLS = "it speaks no TLS"

CERTIFICATE, KEY, AUTHORITY = "tls.crt", "tls.key", "ca.crt"
"""Files in that directory, all PEM: our certificate, its key without passphrase, and the authority's certificate."""

_STRANGE = ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "UNEXPECTED_MESSAGE", "RECORD_LAYER_FAILURE")
"""OpenSSL's error names for data that is not TLS."""


class TlsError(OSError):
    """A connection failed because of TLS; `strerror` is one readable sentence."""

    def __init__(self, reason: str) -> None:
        super().__init__(errno.EPROTO, f"TLS: {reason}")


@dataclass(frozen=True)
class Certificates:
    """TLS contexts of a gateway or hub. TLS 1.3 only; both sides present a certificate.

    Names in certificates are not checked: addresses of robots change, and the hub distinguishes gateways. A
    certificate only proves membership in the fleet.
    """

    directory: Path  #: where the files are
    server: ssl.SSLContext  #: for incoming connections
    client: ssl.SSLContext  #: for outgoing connections

    def fault(self) -> str:
        """Returns why other members would reject our certificate now; "" if they would accept it."""
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
        """Returns the TLS error of a test connection to a server; None if there is none or no TLS answer at all.

        Reads one byte after the handshake, because a TLS 1.3 server checks our certificate only after it.
        """
        try:
            with (
                socket.create_connection((host, port), timeout) as sock,
                self.client.wrap_socket(sock) as wrapped,
            ):
                wrapped.recv(1)
        except ssl.SSLEOFError:
            return None
        except ssl.SSLError as error:
            return error
        except OSError:
            return None
        return None


def certificates_from(
    path: str, environment: Mapping[str, str] = os.environ
) -> Certificates | None:
    """Returns the certificates in `path`, or else in the directory set in the environment; None if neither is set.

    Raises:
        CertificateError: files are missing, cannot be read or do not belong together.
    """
    path = path or environment.get(VARIABLE, "")
    if not path:
        return None
    directory = Path(path).expanduser().absolute()
    try:
        contexts = [
            _context(side, directory) for side in (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT)
        ]
    except OSError as error:
        raise CertificateError(
            f"the TLS certificates in {directory} cannot be used: {_said(error)}"
        ) from None
    contexts[0].num_tickets = 0  # type: ignore[attr-defined]  # sessions are not resumed
    return Certificates(directory, *contexts)


def _context(side: int, directory: Path) -> ssl.SSLContext:
    for name in (CERTIFICATE, KEY, AUTHORITY):
        (directory / name).open("rb").close()  # OpenSSL does not say which one is missing
    context = ssl.SSLContext(side)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname = False
    context.verify_mode = ssl.CERT_REQUIRED
    # Without a password, OpenSSL would prompt for one on the terminal.
    context.load_cert_chain(directory / CERTIFICATE, directory / KEY, password="")
    # Trust only this authority, not the system's.
    context.load_verify_locations(directory / AUTHORITY)
    return context


def _said(error: OSError) -> str:
    if isinstance(error, ssl.SSLError):
        return reason_of(error)
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)


def reason_of(error: ssl.SSLError) -> str:
    """Returns why a handshake or connection failed, as one sentence about the peer."""
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
    """Returns whether a server offers TLS. A hint, not proof, for when a plain server has closed our connection."""
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
    """Returns whether a server answers like Redis without TLS, for when a server has not started TLS."""
    try:
        with socket.create_connection((host, port), timeout) as sock:
            sock.sendall(b"PING\r\n")
            return sock.recv(1) in (b"+", b"-")
    except OSError:
        return False
