"""Access to the dashboard: only a browser with the printed address, on this host, from no other site."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from swarmctl.dashboard.access import COOKIE, MAX_BODY_BYTES, Access, Message, Receive, Scope, Send, Sessions

HOST = "127.0.0.1:8080"


class Site:
    """An application behind the middleware, asked request by request."""

    def __init__(self) -> None:
        self.sessions = Sessions()
        self.reached: list[str] = []
        self._access = Access(self._inside, self.sessions, frozenset({HOST}))

    async def _inside(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.reached.append(scope["path"])
        await send({"type": "http.response.start", "status": 200, "headers": []})

    def ask(self, path: str = "/", *, kind: str = "http", method: str = "GET", **headers: str) -> Message:
        """Return the first message of the answer; `headers` with _ for -."""
        sent: list[Message] = []

        async def send(message: Message) -> None:
            sent.append(message)

        async def receive() -> Message:
            raise AssertionError("a refused request is not read")

        named = {"host": HOST, **{name.replace("_", "-"): value for name, value in headers.items()}}
        path, _, query = path.partition("?")
        scope: dict[str, Any] = {
            "type": kind, "method": method, "path": path, "query_string": query.encode(),
            "headers": [(name.encode(), value.encode()) for name, value in named.items()],
        }  # fmt: skip
        asyncio.run(self._access(scope, receive, send))
        return sent[0]

    def enter(self) -> str:
        """Return the cookie that the one-time token gives."""
        headers = dict(self.ask(f"/?token={self.sessions.token}")["headers"])
        return headers[b"set-cookie"].decode().partition(";")[0]


def test_the_token_is_exchanged_once_for_a_cookie() -> None:
    site = Site()
    cookie = site.enter()
    assert cookie.startswith(f"{COOKIE}=")
    assert site.ask(f"/?token={site.sessions.token}")["status"] == 401
    assert site.reached == []
    assert site.ask("/", cookie=cookie)["status"] == 200


@pytest.mark.parametrize("token", ["", "guessed", "ü"])
def test_a_wrong_token_opens_nothing_and_spends_nothing(token: str) -> None:
    site = Site()
    assert site.ask(f"/?token={token}")["status"] == 401
    assert site.enter()


@pytest.mark.parametrize(
    ("status", "headers"),
    [
        (401, {"cookie": ""}),
        (401, {"cookie": f"{COOKIE}=guessed"}),
        (421, {"host": "attacker.example"}),
        (421, {"host": "127.0.0.1:9"}),
        (403, {"origin": "http://attacker.example"}),
        (403, {"origin": f"https://{HOST}"}),
        (403, {"origin": "null"}),
        (403, {"sec_fetch_site": "cross-site"}),
        (413, {"content_length": str(MAX_BODY_BYTES + 1)}),
        (413, {"content_length": "-1"}),
        (411, {"transfer_encoding": "chunked"}),
    ],
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_request_is_refused(kind: str, status: int, headers: dict[str, str]) -> None:
    site = Site()
    answer = site.ask("/_nicegui", kind=kind, **({"cookie": site.enter()} | headers))
    assert answer.get("status", answer.get("code")) == (status if kind == "http" else 1008)
    assert site.reached == []


def test_the_own_page_may_open_its_websocket() -> None:
    site = Site()
    site.ask("/socket", kind="websocket", cookie=site.enter(), origin=f"http://{HOST}")
    assert site.reached == ["/socket"]


def test_the_token_is_no_answer_to_a_post() -> None:
    site = Site()
    assert site.ask(f"/?token={site.sessions.token}", method="POST")["status"] == 401
