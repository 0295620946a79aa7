"""Access to the dashboard: a one-time token in the address, then a cookie; no other sites. Pure ASGI.

The token of the printed address works once and is exchanged for a session cookie. All other requests need the
cookie, also those of the WebSocket. Requests for another host or from another origin are refused.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "swarmctl_dashboard"
MAX_BODY_BYTES = 1 << 20
"""largest accepted body of a request"""
SAFE_METHODS = ("GET", "HEAD")


class Sessions:
    """The one-time token, and the cookies given for it."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(24)
        self._is_used = False
        self._cookies: set[str] = set()

    def exchange(self, token: str) -> str | None:
        """Return a new cookie for the one-time token; None for a wrong or used token."""
        if self._is_used or not hmac.compare_digest(token.encode(), self.token.encode()):
            return None
        self._is_used = True
        cookie = secrets.token_urlsafe(32)
        self._cookies.add(cookie)
        return cookie

    def is_known(self, cookie: str) -> bool:
        return any(hmac.compare_digest(cookie.encode(), known.encode()) for known in self._cookies)


class Access:
    """ASGI middleware that lets only known sessions of this host pass."""

    def __init__(self, app: App, sessions: Sessions, hosts: frozenset[str]) -> None:
        """`hosts`: accepted values of the Host header, with the port."""
        self._app, self._sessions, self._hosts = app, sessions, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        refusal = self._refusal(scope, headers)
        if refusal is None:
            await self._app(scope, receive, send)
            return
        token = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        is_entry = scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/"
        if refusal == 401 and is_entry and (cookie := self._sessions.exchange(token)):
            kept = f"{COOKIE}={cookie}; Path=/; HttpOnly; SameSite=Strict"
            await _answer(send, 303, "", [("location", "/"), ("set-cookie", kept)])
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await _answer(send, refusal, _TEXTS[refusal], [])

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> int | None:
        """Return the HTTP status of a refusal, or None for a request that may pass."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self._hosts:
            return 421
        scheme = "https" if scope.get("scheme") in ("https", "wss") else "http"
        if origin is not None and origin != f"{scheme}://{host}":
            return 403
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return 403
        if "transfer-encoding" in headers:  # a body of unknown length
            return 411
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > MAX_BODY_BYTES:
            return 413
        cookie = SimpleCookie()
        try:
            cookie.load(headers.get("cookie", ""))
        except CookieError:
            return 401
        session = cookie.get(COOKIE)
        return None if session is not None and self._sessions.is_known(session.value) else 401


_TEXTS = {
    401: "the dashboard needs the address that its command has printed; each address works once",
    403: "the request comes from another site",
    411: "the request does not say its length",
    413: "the request is too large",
    421: "the dashboard has another address",
}


async def _answer(send: Send, status: int, text: str, headers: list[tuple[str, str]]) -> None:
    kind = [("content-type", "text/plain; charset=utf-8"), ("cache-control", "no-store"), *headers]
    raw = [(name.encode(), value.encode()) for name, value in kind]
    await send({"type": "http.response.start", "status": status, "headers": raw})
    await send({"type": "http.response.body", "body": text.encode()})
