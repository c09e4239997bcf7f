"""Authentication for everything that is served: sessions, tokens, origins."""

import asyncio
import http.cookies
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple, Protocol

from aiohttp import web

from pioneer_web.access.access_control import Access, Role, same_origin
from pioneer_web.access.pace import Pace

LOGIN, LOGOUT = "/login", "/logout"
LONGEST_LOGIN = 1000
"""Maximum size of a login request [bytes]."""
LOGIN_LIMIT = 10.0
"""Time-out for a login's body [s]."""
UNAUTHORISED = 4401
"""WebSocket close code: the session has expired."""
_POLICY = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
}


class Turn(Protocol):
    """Waits until one more request, or frame of this size [bytes], may be handled."""

    async def __call__(self, size: int = 0) -> None:
        """Waits."""


class Session(NamedTuple):
    """What an authenticated client may do."""

    role: Role
    is_valid: Callable[[], bool]  #: whether it has not expired since
    turn: Turn  #: waits until one more request may be handled, or a frame of a size [bytes]


Serve = Callable[[web.BaseRequest, Session], Awaitable[web.StreamResponse]]


class Guard:
    """Passes requests with a session cookie or a token, together with their `Session`.

    Args:
        serve: answers these requests.
        access: sessions and tokens.
        login_page: HTML sent with status 401 to unauthenticated clients.
        port: part of the cookie's name, because browsers send cookies to every port of a host.
        encrypted: whether the server uses TLS.
    """

    def __init__(
        self, serve: Serve, access: Access, login_page: str, port: int, encrypted: bool
    ) -> None:
        self.cookie = f"pioneer_{port}"
        self._serve = serve
        self._access = access
        self._login_page = login_page
        self._encrypted = encrypted
        self._pace = Pace()

    async def __call__(self, request: web.BaseRequest) -> web.StreamResponse:
        """Answers one request."""
        if (request.method, request.path) == ("POST", LOGIN):
            return await self._login(request)
        session = self._session(request)
        if session is None:
            return web.Response(
                text=self._login_page, status=401, content_type="text/html", headers=_POLICY
            )
        if (request.method, request.path) == ("POST", LOGOUT):
            self._access.logout(self._cookie_of(request))
            answer = web.Response(status=204)
            answer.del_cookie(self.cookie)
            return answer
        await session.turn()
        response = await self._serve(request, session)
        if not response.prepared:
            response.headers.update(_POLICY)
        return response

    def _session(self, request: web.BaseRequest) -> Session | None:
        """Returns the session of a request; None if it is not authenticated."""
        role = self._role_of_token(request)
        if role is not None:
            return Session(role, _always, self._turn_of(role))
        # A token is sent deliberately. Browsers attach cookies to requests of any site, so check the origin (CSRF).
        if _acts(request) and self._is_foreign(request):
            return None
        cookie = self._cookie_of(request)
        role = self._access.role(cookie, time.monotonic())
        if role is None:
            return None

        def is_valid() -> bool:
            return self._access.role(cookie, time.monotonic()) is not None

        return Session(role, is_valid, self._turn_of(role))

    def _turn_of(self, role: Role) -> Turn:
        """Returns the limit of rate for a role: all viewers together have one, operators have none."""
        return _at_once if role >= Role.OPERATOR else self._pace.turn

    def _cookie_of(self, request: web.BaseRequest) -> str:
        try:
            return request.cookies.get(self.cookie, "")
        except http.cookies.CookieError:  # of another application on this host
            return ""

    def _is_foreign(self, request: web.BaseRequest) -> bool:
        headers = request.headers
        return not same_origin(headers.get("Origin", ""), headers.get("Host", ""), self._encrypted)

    def _role_of_token(self, request: web.BaseRequest) -> Role | None:
        kind, _, token = request.headers.get("Authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return self._access.role_of_token(token)
        # Foxglove can set neither headers nor cookies, so its token is in the path. The path is not logged here.
        path, _, token = request.path.rpartition("/")
        return self._access.role_of_token(token) if path == "/foxglove" else None

    async def _login(self, request: web.BaseRequest) -> web.Response:
        if self._is_foreign(request):
            return web.Response(text="another origin", status=403)
        try:
            body = await asyncio.wait_for(_body(request), LOGIN_LIMIT)
        except TimeoutError:
            return web.Response(text="the login is incomplete", status=408)
        token = body[:LONGEST_LOGIN].decode(errors="replace").strip()
        session = self._access.login(token, time.monotonic())
        if session is None:
            return web.Response(text="unknown token", status=401)
        answer = web.Response(status=204)
        answer.set_cookie(
            self.cookie,
            session,
            max_age=int(self._access.lifetime),
            httponly=True,
            samesite="strict",
            secure=self._encrypted,
        )
        return answer


def _acts(request: web.BaseRequest) -> bool:
    """Returns whether a request may change something."""
    is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
    return is_socket or request.method not in ("GET", "HEAD")


def _always() -> bool:
    return True


async def _at_once(size: int = 0) -> None:
    pass


async def _body(request: web.BaseRequest) -> bytes:
    """Returns a request's body, at most a little more than the maximum size of a login."""
    body = b""
    async for piece in request.content.iter_any():
        body += piece
        if len(body) > LONGEST_LOGIN:
            break
    return body
