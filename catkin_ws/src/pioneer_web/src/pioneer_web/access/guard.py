"""Authentication for everything that is served: sessions, tokens, origins."""

import asyncio
import http.cookies
import time
from collections.abc import Mapping
from typing import Any

from starlette.responses import HTMLResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from pioneer_web.access.access_control import Access, Role, same_origin
from pioneer_web.access.pace import EVENT, PAGE, Pace

LOGIN, LOGOUT = "/login", "/logout"
LONGEST_LOGIN = 1000
"""Maximum size of a login request [bytes]."""
LOGIN_LIMIT = 10.0
"""Time-out for a login's body [s]."""
_EVENTS = "/_nicegui_ws"
"""Path of the connection with the events of a page's elements."""
_POLICY = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
}


class Guard:
    """ASGI middleware that passes requests with a session cookie or a token, and puts their role into the scope.

    Args:
        app: the protected application.
        access: sessions and tokens.
        login_page: HTML sent with status 401 to unauthenticated clients.
        port: part of the cookie's name, because browsers send cookies to every port of a host.
        encrypted: whether the server uses TLS.
    """

    def __init__(
        self, app: ASGIApp, access: Access, login_page: str, port: int, encrypted: bool
    ) -> None:
        self._app, self._access, self._login_page, self._encrypted = (
            app,
            access,
            login_page,
            encrypted,
        )
        self.cookie = f"pioneer_{port}"
        self._pace = Pace()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request or connection."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {
            key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]
        }
        writes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        foreign = not same_origin(
            headers.get("origin", ""), headers.get("host", ""), self._encrypted
        )
        session = self._session(headers)
        bearer = self._role_of_bearer(headers, scope)
        if scope["type"] == "http" and scope["path"] == LOGIN and scope["method"] == "POST":
            answer = Response("another origin", 403) if foreign else await self._login(receive)
            await answer(scope, receive, send)
            return
        # A token is sent deliberately. Browsers attach cookies to requests of any site, so check the origin (CSRF).
        role = bearer or (
            None if writes and foreign else self._access.role(session, time.monotonic())
        )
        if role is None:
            await self._refuse(scope, receive, send)
            return
        if scope["type"] == "http" and scope["path"] == LOGOUT and scope["method"] == "POST":
            self._access.logout(session)
            answer = Response(status_code=204)
            answer.delete_cookie(self.cookie)
            await answer(scope, receive, send)
            return
        scope["role"] = role
        scope["still"] = (
            (lambda: True)
            if bearer
            else lambda: self._access.role(session, time.monotonic()) is not None
        )
        if role < Role.OPERATOR:
            await self._pace.turn(
                PAGE
                if scope["path"] == "/"
                else EVENT
                if scope["path"].startswith(_EVENTS)
                else 1.0
            )
            if scope["type"] == "websocket":
                receive = self._paced(receive, EVENT if scope["path"].startswith(_EVENTS) else 1.0)
        await self._app(scope, receive, _with_policy(send))

    def _paced(self, receive: Receive, cost: float) -> Receive:
        """Returns ``receive`` for a viewer's connection: all viewers' frames together are limited in rate."""

        async def received() -> Any:
            message = await receive()
            await self._pace.turn(cost)
            return message

        return received

    def _session(self, headers: Mapping[str, str]) -> str:
        try:
            jar: http.cookies.SimpleCookie[str] = http.cookies.SimpleCookie(
                headers.get("cookie", "")
            )
        except http.cookies.CookieError:
            return ""
        return jar[self.cookie].value if self.cookie in jar else ""

    def _role_of_bearer(self, headers: Mapping[str, str], scope: Scope) -> Role | None:
        kind, _, token = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return self._access.role_of_token(token)
        # Foxglove can set neither headers nor cookies, so its token is in the path. The path is not logged here.
        path, _, token = scope["path"].rpartition("/")
        return self._access.role_of_token(token) if path == "/foxglove" else None

    async def _login(self, receive: Receive) -> Response:
        try:
            body = await asyncio.wait_for(_body(receive), LOGIN_LIMIT)
        except TimeoutError:
            return Response("the login is incomplete", 408)
        session = self._access.login(
            body[:LONGEST_LOGIN].decode(errors="replace").strip(), time.monotonic()
        )
        if session is None:
            return Response("unknown token", 401)
        answer = Response(status_code=204)
        answer.set_cookie(
            self.cookie,
            session,
            int(self._access.lifetime),
            httponly=True,
            samesite="strict",
            secure=self._encrypted,
        )
        return answer

    async def _refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 4401})
            return
        await HTMLResponse(self._login_page, 401, _POLICY)(scope, receive, send)


async def _body(receive: Receive) -> bytes:
    """Returns a request's body, at most a little more than the maximum size of a login."""
    body = b""
    more = True
    while more and len(body) <= LONGEST_LOGIN:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False)
    return body


def _with_policy(send: Send) -> Send:
    async def sent(message: Any) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [
                *message["headers"],
                *((key.lower().encode(), value.encode()) for key, value in _POLICY.items()),
            ]
        await send(message)

    return sent
