"""CPace: two sides check that they know the same password; a side that does not know it learns nothing.

Neither a peer nor an eavesdropper can test passwords offline: each guess needs an exchange with a side that knows the
password. The suite is CPACE-X25519-SHA512 of draft-irtf-cfrg-cpace (section 5.1), with explicit key confirmation
(section 9.4).
"""

import hashlib
import hmac
import secrets

from nacl.bindings import crypto_scalarmult
from nacl.exceptions import CryptoError

from rocon_hub_protocol.code import HubProtocolError

SHARE_LENGTH = 32
"""Length of the share, which each side sends first [bytes]."""

_SUITE = b"CPace255"
_BLOCK = 128  # block size of SHA-512; the padded password fills the first block
_PRIME = 2**255 - 19
_A = 486662


class ProofError(HubProtocolError):
    """The other side sent invalid data in this exchange."""


class Exchange:
    """Our side of one exchange; must not be reused.

    Args:
        password: the password that both sides should know.
        channel: purpose of this exchange, the same on both sides.
        session: bytes agreed on by both sides and never used before.
    """

    def __init__(self, password: str, channel: bytes, session: bytes) -> None:
        self._session = session
        self._scalar = secrets.token_bytes(32)
        #: the share to send to the other side
        self.share = crypto_scalarmult(self._scalar, generator(password.encode(), channel, session))

    def tags(self, first: bytes, second: bytes) -> tuple[bytes, bytes]:
        """Returns the tags by which initiator and responder prove their knowledge of the password.

        Args:
            first: the initiator's share.
            second: the responder's share; one of the two is ours.

        Raises:
            ProofError: the other share is invalid.
        """
        other = second if first == self.share else first
        if len(other) != SHARE_LENGTH:
            raise ProofError(f"a share has {SHARE_LENGTH} bytes, not {len(other)}")
        if other == self.share:  # the sender could then reflect our own tag
            raise ProofError("the share is our own")
        try:
            point = crypto_scalarmult(self._scalar, other)
        except CryptoError:
            raise ProofError("the share is not a point of the curve") from None
        said = _joined(first, b""), _joined(second, b"")
        key = hashlib.sha512(
            _joined(_SUITE + b"_ISK", self._session, point) + said[0] + said[1]
        ).digest()
        key = hashlib.sha512(b"CPaceMac" + self._session + key).digest()
        return hmac.digest(key, said[0], "sha512"), hmac.digest(key, said[1], "sha512")


def generator(password: bytes, channel: bytes, session: bytes) -> bytes:
    """Returns the point of Curve25519, as its u-coordinate, that a password maps to in one exchange."""
    padding = max(0, _BLOCK - 1 - len(_joined(password)) - len(_joined(_SUITE)))
    text = _joined(_SUITE, password, bytes(padding), channel, session)
    digest = hashlib.sha512(text).digest()[:SHARE_LENGTH]
    return _elligator(int.from_bytes(digest, "little") & (2**255 - 1)).to_bytes(
        SHARE_LENGTH, "little"
    )


def _elligator(number: int) -> int:
    """Maps a field element to the curve (RFC 9380, section 6.7.1)."""
    u = -_A * pow(1 + 2 * number * number, -1, _PRIME) % _PRIME
    square = pow(u * (u * u + _A * u + 1), (_PRIME - 1) // 2, _PRIME)
    return u if square in (0, 1) else (-u - _A) % _PRIME


def _joined(*parts: bytes) -> bytes:
    """Returns the parts, each prefixed with its length, so that different lists never give the same bytes."""
    return b"".join(_length(part) + part for part in parts)


def _length(part: bytes) -> bytes:
    """Returns the length of a part in LEB128."""
    rest, digits = len(part), bytearray()
    while rest > 127:
        digits.append(rest & 127 | 128)
        rest >>= 7
    return bytes((*digits, rest))
