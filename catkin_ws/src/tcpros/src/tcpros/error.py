"""The errors of this package."""


class TcprosError(Exception):
    """Base class of this package's errors. A connection whose parser raises one is closed."""


class CertificateError(TcprosError):
    """Certificates cannot be used or created."""
