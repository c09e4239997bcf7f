"""Who may see the fleet and who may drive it: tokens, sessions, origins."""

import enum
import hmac
import secrets
from collections.abc import Callable, Mapping
from urllib.parse import urlsplit

SESSION_BYTES = 24
MOST_SESSIONS = 1000
"""Beyond it the oldest session ends."""


class Role(enum.IntEnum):
    """What a session may do; a higher one includes the lower."""

    VIEWER = 1
    OPERATOR = 2


class Access:
    """Issues expiring sessions in exchange for tokens.

    Args:
        tokens: the secret of each role.
        lifetime: of a session [s].
        new_secret: returns the identifier of a session.
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
        """Returns the role that a token gives; None for an unknown one. Takes as long for one as for the other."""
        given = token.encode()
        found = [role for role, one in self._tokens.items() if hmac.compare_digest(one.encode(), given)]
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
        """Returns a session's role; None once it has expired, and for an unknown one."""
        role, until = self._sessions.get(session, (None, 0.0))
        return role if now < until else None

    def logout(self, session: str) -> None:
        """Ends a session."""
        self._sessions.pop(session, None)


def same_origin(origin: str, host: str, encrypted: bool) -> bool:
    """Returns whether a request's ``Origin`` is the page's own; a program that is no browser sends none.

    Args:
        origin: the header, empty where there is none.
        host: the header ``Host`` of the same request.
        encrypted: whether the server speaks TLS.
    """
    if not origin:
        return True
    parts = urlsplit(origin)
    return parts.scheme == ("https" if encrypted else "http") and parts.netloc.lower() == host.lower()
