"""The result codes of the gateway's services, and the errors of this package."""

import enum


class Code(enum.IntEnum):
    """Copy of `gateway_msgs/ErrorCodes`, verified by a test; the core must not import messages."""

    SUCCESS = 0
    NO_HUB_CONNECTION = 1
    HUB_CONNECTION_ALREADY_EXISTS = 11
    HUB_CONNECTION_UNRESOLVABLE = 12
    HUB_CONNECTION_BLACKLISTED = 13
    HUB_CONNECTION_FAILED = 14
    HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST = 15
    HUB_NAME_NOT_FOUND = 16
    HUB_CONNECTION_LOST = 17
    HUB_UNKNOWN_ERROR = 19
    FLIP_RULE_ALREADY_EXISTS = 22
    FLIP_PATTERN_ALREDY_EXISTS = 23
    FLIP_REMOTE_GATEWAY_FIREWALLING = 24
    ADVERTISEMENT_EXISTS = 31
    ADVERTISEMENT_NOT_FOUND = 32
    UNKNOWN_ADVERTISEMENT_ERROR = 39
    PULL_RULE_ALREADY_EXISTS = 41
    REMOTE_GATEWAY_NOT_VISIBLE = 51
    REMOTE_GATEWAY_SELF_IS_NOT = 52
    REMOTE_GATEWAY_TARGET_HAS_MULTIPLE_MATCHES = 53


class HubProtocolError(Exception):
    """Base class of this package's errors."""


class HubError(HubProtocolError):
    """A hub cannot be used."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code = code  #: the result code of `connect_hub`
