"""The handshake by which a gateway and a hub prove to each other that they know the password. See `docs/gateway.md`.

    gateway: ROCON-PROVE 1 <session>       hub: +<share>
    gateway: <share> <tag>                 hub: +<tag>, then the Redis protocol

All values are hexadecimal; each message is one line ended by CR LF. Redis, and so a hub without a password, answers
the first line with an error. The hub refuses with `-` and a reason.
"""

import hmac
import re
import secrets

from rocon_hub_protocol.cpace import Exchange, ProofError

LONGEST_LINE = 512
"""Maximum length of a line [bytes]; a longer one is invalid."""

UNPROVEN = b"-NOAUTH this hub wants a proof of its password\r\n"
"""The answer to a client that uses the plain Redis protocol."""

REFUSED = b"-WRONGPASS the password is not this hub's\r\n"

BUSY = b"-BUSY too many proofs from your host have failed\r\n"
"""The answer to a proof that was not checked."""

_CHANNEL = b"rocon hub 1"
_FIRST = re.compile(rb"ROCON-PROVE 1 ([0-9a-f]{32})\r\n")
_PROOF = re.compile(rb"([0-9a-f]{64}) ([0-9a-f]{128})\r\n")
_SHARE = re.compile(rb"\+([0-9a-f]{64})\r\n")
_TAG = re.compile(rb"\+([0-9a-f]{128})\r\n")


class GatewaySide:
    """The gateway's side. Send `first`, then pass the hub's lines to `prove` and `accepts` in this order.

    Args:
        password: our password.
    """

    def __init__(self, password: str) -> None:
        session = secrets.token_bytes(16)
        self._exchange = Exchange(password, _CHANNEL, session)
        self._expected = b""
        self.first = b"ROCON-PROVE 1 %s\r\n" % session.hex().encode()  #: the first line

    def prove(self, line: bytes) -> bytes:
        """Returns our proof, given the hub's first line; raises ProofError if that line is invalid."""
        share = _bytes(_SHARE, line)
        mine, self._expected = self._exchange.tags(self._exchange.share, share)
        return b"%s %s\r\n" % (self._exchange.share.hex().encode(), mine.hex().encode())

    def accepts(self, line: bytes) -> bool:
        """Returns whether the hub's second line proves that it knows the password; raises ProofError if malformed."""
        return hmac.compare_digest(_bytes(_TAG, line), self._expected)


class HubSide:
    """The hub's side, for one client.

    Args:
        password: our password.
        first: the client's first line; raises ProofError if it is invalid.
    """

    def __init__(self, password: str, first: bytes) -> None:
        self._exchange = Exchange(password, _CHANNEL, _bytes(_FIRST, first))
        self.answer = b"+%s\r\n" % self._exchange.share.hex().encode()  #: our first line

    def verdict(self, line: bytes) -> tuple[bool, bytes]:
        """Returns whether the client's proof is correct, and our answer; raises ProofError if the line is invalid."""
        found = _PROOF.fullmatch(line)
        if not found:
            raise ProofError("it sends no proof")
        share, tag = (bytes.fromhex(one.decode()) for one in found.groups())
        expected, mine = self._exchange.tags(share, self._exchange.share)
        if not hmac.compare_digest(tag, expected):
            return False, REFUSED
        return True, b"+%s\r\n" % mine.hex().encode()


def _bytes(pattern: re.Pattern[bytes], line: bytes) -> bytes:
    found = pattern.fullmatch(line)
    if not found:
        raise ProofError("it does not speak the hub's protocol")
    return bytes.fromhex(found[1].decode())
