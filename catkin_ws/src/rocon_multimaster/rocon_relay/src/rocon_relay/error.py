"""The base class of this package's errors."""

from tcpros.error import TcprosError


class RelayError(TcprosError):
    """Base class of the errors of the data plane."""
