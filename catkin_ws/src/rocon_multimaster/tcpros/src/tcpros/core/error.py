"""The errors of this package."""


class TcprosError(Exception):
    """The root of the errors of this package, and of those for which a connection is closed."""


class CertificateError(TcprosError):
    """Certificates that cannot be used or made."""
