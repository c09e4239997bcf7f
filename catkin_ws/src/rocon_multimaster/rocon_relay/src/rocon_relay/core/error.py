"""The root of this package's errors."""

from tcpros.core.error import TcprosError


class RelayError(TcprosError):
    """The root of what the data plane raises."""
