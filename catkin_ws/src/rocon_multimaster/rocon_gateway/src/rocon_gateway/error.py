"""The errors of this package."""

from rocon_hub_protocol.code import Code


class GatewayError(Exception):
    """Base class of this package's errors."""


class ConfigError(GatewayError):
    """An invalid parameter value."""


class RequestError(GatewayError):
    """A refused request; nothing was changed."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code = code  #: the value of `result` in the service's response
