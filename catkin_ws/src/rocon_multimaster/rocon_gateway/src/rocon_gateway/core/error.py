"""The errors of this package."""

from rocon_hub_protocol.core.code import Code


class GatewayError(Exception):
    """The root of this package's errors."""


class ConfigError(GatewayError):
    """An invalid parameter value."""


class RequestError(GatewayError):
    """A request that is refused; nothing was changed."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code = code  #: what the service answers in `result`
