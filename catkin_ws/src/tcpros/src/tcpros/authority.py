"""A fleet's certificate authority: creates keys and signs certificates with the `openssl` program."""

import ipaddress
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from tcpros.error import CertificateError
from tcpros.tls import AUTHORITY, CERTIFICATE, KEY

AUTHORITY_KEY = "ca.key"
"""The authority's private key. Anyone who has it can add members to the fleet, so it never leaves this directory."""

AUTHORITY_DAYS, DAYS = 3650, 825
"""Validity of the authority's certificate and of machine certificates [days]."""

_CURVE = ("-pkeyopt", "ec_paramgen_curve:P-256")
_NEW_KEY = ("-newkey", "ec", *_CURVE, "-noenc")
_EXTENSIONS = """basicConstraints=critical,CA:FALSE
keyUsage=critical,digitalSignature
extendedKeyUsage=serverAuth,clientAuth
subjectKeyIdentifier=hash
authorityKeyIdentifier=keyid
"""


class Authority:
    """A certificate authority kept in a directory. It is created on first use and reused afterwards.

    Args:
        directory: created if absent.
        days: validity of the certificates it signs [days].
    """

    def __init__(self, directory: Path, days: int = DAYS) -> None:
        self._directory = directory
        self._days = days
        self._certificate, self._key = directory / AUTHORITY, directory / AUTHORITY_KEY

    def certify(self, name: str) -> Path:
        """Creates a key and a certificate for a machine, replacing existing ones; returns the machine's directory.

        Raises:
            CertificateError: the name is invalid, or openssl cannot be run or fails.
        """
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
            raise CertificateError(
                f"{name!r} is no name for a machine: only letters, digits, dot, hyphen and underscore"
            )
        try:
            return self._certify(name)
        except OSError as error:
            raise CertificateError(f"{error.filename}: {error.strerror}") from None

    def _certify(self, name: str) -> Path:
        self._directory.mkdir(parents=True, exist_ok=True)
        self._establish()
        target = self._directory / name
        target.mkdir(mode=0o700, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=self._directory) as folder:
            made = Path(folder)
            # Browsers check only the subjectAltName.
            (made / "extensions").write_text(f"{_EXTENSIONS}subjectAltName={_alternative(name)}\n")
            subject = ("-subj", f"/CN={name}")
            _openssl("req", *_NEW_KEY, *subject, "-keyout", made / KEY, "-out", made / "request")
            signer = ("-CA", self._certificate, "-CAkey", self._key, "-days", str(self._days))
            extensions = ("-extfile", made / "extensions")
            _openssl(
                "x509",
                "-req",
                "-in",
                made / "request",
                *signer,
                *extensions,
                "-out",
                made / CERTIFICATE,
            )
            shutil.copyfile(self._certificate, made / AUTHORITY)
            # The certificate comes last, and a former one goes first: where there is one, the rest fits it, even after
            # a kill in between.
            (target / CERTIFICATE).unlink(missing_ok=True)
            for file in (AUTHORITY, KEY, CERTIFICATE):
                (made / file).replace(target / file)
        return target

    def _establish(self) -> None:
        if self._certificate.exists() and self._key.exists():
            return
        if self._certificate.exists():
            text = f"{self._directory} has only one of {AUTHORITY} and {AUTHORITY_KEY}; name another directory"
            raise CertificateError(text)
        with tempfile.TemporaryDirectory(dir=self._directory) as folder:
            made = Path(folder)
            # A call that was killed may have left the key alone: its certificate can be made at any time.
            if not self._key.exists():
                _openssl("genpkey", "-algorithm", "EC", *_CURVE, "-out", made / AUTHORITY_KEY)
                (made / AUTHORITY_KEY).replace(self._key)
            means = (
                "-addext",
                "basicConstraints=critical,CA:TRUE,pathlen:0",
                "-addext",
                "keyUsage=critical,keyCertSign",
            )
            subject = ("-subj", "/CN=Fleet authority", "-days", str(AUTHORITY_DAYS))
            out = ("-key", self._key, "-out", made / AUTHORITY)
            _openssl("req", "-x509", *subject, *means, *out)
            (made / AUTHORITY).replace(self._certificate)


def _alternative(name: str) -> str:
    try:
        return f"IP:{ipaddress.ip_address(name)}"
    except ValueError:
        return f"DNS:{name}"


def _openssl(*arguments: str | Path) -> None:
    program = shutil.which("openssl")
    if program is None:
        raise CertificateError("there is no openssl on the PATH; install the package openssl")
    # The umask keeps the files private to this user.
    argv = [program, *map(str, arguments)]
    done = subprocess.run(
        argv, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, umask=0o077
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["it said nothing"]
        raise CertificateError(f"openssl {arguments[0]}: {lines[-1]}")
