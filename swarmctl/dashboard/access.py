"""Access to the page: tokens, sessions and roles, one host and one origin, small requests.

A token is exchanged for a session cookie. All other requests need the cookie, also those of the WebSocket.
Requests for another host or from another origin are refused.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, Iterable, Mapping, MutableMapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any, Literal
from urllib.parse import parse_qs

from swarmctl.bus.rate import TokenBucket
from swarmctl.core.operator_text import printable

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
Role = Literal["operator", "viewer"]

COOKIE = "swarmctl_dashboard"
"""begin of the cookie's name; the port follows, since a browser sends a host's cookies to all its ports"""
SESSION = "swarmctl.session"
"""key of the session in the scope of an accepted request"""
MAX_BODY_BYTES = 1 << 20
"""largest accepted body of a request"""
MAX_NAME = 24
"""longest name of a person [characters]"""
WRONG_PER_S, WRONG_BURST = 0.1, 10
"""limits on wrong tokens from one address; above them a right token is refused too"""
MAX_ADDRESSES = 1000
"""number of addresses of wrong tokens that are remembered"""


@dataclass(slots=True)
class Session:
    """One browser that has shown a token."""

    role: Role
    name: str
    """name of the person, or role with a number; and the address"""
    n_pages: int = 0
    """number of its open pages"""


@dataclass(slots=True)
class Sessions:
    """The tokens, and the sessions of the browsers that have shown one."""

    is_one_time: bool = True
    """True: the operator's token works once, and there is no viewer's"""
    tokens: dict[Role, str] = field(init=False)
    _by_cookie: dict[str, Session] = field(default_factory=dict)

    def __post_init__(self) -> None:
        roles: tuple[Role, ...] = ("operator",) if self.is_one_time else ("operator", "viewer")
        self.tokens = {role: secrets.token_urlsafe(24) for role in roles}

    def exchange(self, token: str, name: str, address: str) -> str | None:
        """Return the cookie of a new session for a token; None for a wrong or used token."""
        for role, right in self.tokens.items():
            if not hmac.compare_digest(token.encode(), right.encode()):
                continue
            if self.is_one_time:
                self.tokens = {}
            number = 1 + sum(session.role == role for session in self._by_cookie.values())
            who = printable(name[:MAX_NAME]) or f"{role} {number}"
            cookie = secrets.token_urlsafe(32)
            self._by_cookie[cookie] = Session(role, f"{who} at {address}")
            return cookie
        return None

    def of_cookie(self, cookie: str) -> Session | None:
        found = None
        for known, session in self._by_cookie.items():
            if hmac.compare_digest(cookie.encode(), known.encode()):
                found = session
        return found

    @property
    def present(self) -> list[Session]:
        """The sessions with an open page."""
        return [session for session in self._by_cookie.values() if session.n_pages > 0]


class Access:
    """ASGI middleware that lets only known sessions of this host pass."""

    def __init__(
        self,
        app: App,
        sessions: Sessions,
        hosts: frozenset[str],
        clock: Callable[[], float],
        images_from: Iterable[str] = (),
    ) -> None:
        """`hosts`: accepted values of the Host header, with the port; `images_from`: origins of map tiles."""
        self._app, self._sessions, self._hosts, self._clock = app, sessions, hosts, clock
        self._policy = _POLICY.format(" ".join(["'self'", "data:", "blob:", *images_from]))
        self._wrong: dict[str, TokenBucket] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        refusal = self._refusal(scope, headers)
        if refusal is None:
            await self._app(scope, receive, self._with_policy(send))
            return
        is_entry = scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/"
        if refusal == 401 and is_entry:
            entered = self._enter(scope)
            if isinstance(entered, str):
                secure = "; Secure" if _is_encrypted(scope) else ""
                kept = f"{_cookie_name(headers)}={entered}; Path=/; HttpOnly; SameSite=Strict{secure}"
                await _answer(send, 303, "", [("location", "/"), ("set-cookie", kept)])
                return
            refusal = entered
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await _answer(send, refusal, _TEXTS[refusal], [])

    def _enter(self, scope: Scope) -> str | int:
        """Return the cookie for the token of a request, or the HTTP status of a refusal."""
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        token, name = query.get("token", [""])[0], query.get("name", [""])[0]
        address, now_s = (scope.get("client") or ("?",))[0], self._clock()
        if not token:
            return 401
        bucket = self._wrong.setdefault(address, TokenBucket(WRONG_PER_S, WRONG_BURST))
        if not bucket.try_take(now_s):
            return 429
        cookie = self._sessions.exchange(token, name, address)
        if cookie is not None:
            del self._wrong[address]
        while len(self._wrong) > MAX_ADDRESSES:
            del self._wrong[next(iter(self._wrong))]
        return cookie or 401

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> int | None:
        """Return the HTTP status of a refusal, or None for a request that may pass."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self._hosts:
            return 421
        scheme = "https" if _is_encrypted(scope) else "http"
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
        shown = cookie.get(_cookie_name(headers))
        session = None if shown is None else self._sessions.of_cookie(shown.value)
        scope[SESSION] = session
        return 401 if session is None else None

    def _with_policy(self, send: Send) -> Send:
        """Return a sender that adds the content policy: a page loads nothing from other origins."""

        async def sender(message: Message) -> None:
            if message["type"] == "http.response.start":
                policy = (b"content-security-policy", self._policy.encode())
                message = {**message, "headers": [*message.get("headers", ()), policy]}
            await send(message)

        return sender


_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "font-src 'self' data:; img-src {}; object-src 'none'; base-uri 'self'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_TEXTS = {
    401: "the dashboard needs the address that its command has printed",
    403: "the request comes from another site",
    411: "the request does not say its length",
    413: "the request is too large",
    421: "the dashboard has another address",
    429: "too many wrong tokens from this address; wait a minute",
}


def _cookie_name(headers: Mapping[str, str]) -> str:
    """Return the name of this server's cookie; a checked Host header has the port."""
    return f"{COOKIE}_{headers['host'].rpartition(':')[2]}"


def _is_encrypted(scope: Scope) -> bool:
    return scope.get("scheme") in ("https", "wss")


async def _answer(send: Send, status: int, text: str, headers: list[tuple[str, str]]) -> None:
    kind = [("content-type", "text/plain; charset=utf-8"), ("cache-control", "no-store"), *headers]
    raw = [(name.encode(), value.encode()) for name, value in kind]
    await send({"type": "http.response.start", "status": status, "headers": raw})
    await send({"type": "http.response.body", "body": text.encode()})
