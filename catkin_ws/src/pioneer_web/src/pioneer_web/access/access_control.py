"""Access control, for viewing and for driving the fleet: tokens, sessions, origins."""

import enum
import hmac
import secrets
from collections.abc import Callable, Mapping
from urllib.parse import urlsplit

SESSION_BYTES = 24
MOST_SESSIONS = 1000
"""Maximum number of sessions; a further login ends the oldest."""


class Role(enum.IntEnum):
    """Permission level of a session; a higher level includes the lower ones."""

    VIEWER = 1
    OPERATOR = 2


class Access:
    """Issues expiring sessions in exchange for tokens.

    Args:
        tokens: the secret token of each role.
        lifetime: of a session [s].
        new_secret: returns a new session identifier.
    """

    def __init__(
        self,
        tokens: Mapping[Role, str],
        lifetime: float,
        new_secret: Callable[[], str] = lambda: secrets.token_urlsafe(SESSION_BYTES),
    ) -> None:
        self.lifetime = lifetime
        self._tokens, self._new_secret = dict(tokens), new_secret
        self._sessions: dict[str, tuple[Role, float]] = {}

    def role_of_token(self, token: str) -> Role | None:
        """Returns the role of a token, None if it is unknown; in constant time."""
        given = token.encode()
        found = [
            role for role, one in self._tokens.items() if hmac.compare_digest(one.encode(), given)
        ]
        return max(found, default=None)

    def login(self, token: str, now: float) -> str | None:
        """Returns a new session's identifier; None for an unknown token. ``now`` is monotonic [s]."""
        role = self.role_of_token(token)
        if role is None:
            return None
        self._sessions = {one: entry for one, entry in self._sessions.items() if entry[1] > now}
        while len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        session = self._new_secret()
        self._sessions[session] = role, now + self.lifetime
        return session

    def role(self, session: str, now: float) -> Role | None:
        """Returns a session's role; None if it has expired or is unknown."""
        role, until = self._sessions.get(session, (None, 0.0))
        return role if now < until else None

    def logout(self, session: str) -> None:
        """Ends a session."""
        self._sessions.pop(session, None)


def same_origin(origin: str, host: str, encrypted: bool) -> bool:
    """Returns whether a request's ``Origin`` is the page's own. Non-browser clients send none and pass.

    Args:
        origin: the ``Origin`` header, empty if absent.
        host: the ``Host`` header of the same request.
        encrypted: whether the server uses TLS.
    """
    if not origin:
        return True
    parts = urlsplit(origin)
    return (
        parts.scheme == ("https" if encrypted else "http") and parts.netloc.lower() == host.lower()
    )
