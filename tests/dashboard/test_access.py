"""Access to the dashboard: only a browser with the printed address, on this host, from no other site."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from swarmctl.core.operator_text import printable
from swarmctl.dashboard.access import (
    COOKIE,
    MAX_BODY_BYTES,
    SESSION,
    WRONG_BURST,
    WRONG_PER_S,
    Access,
    Message,
    Receive,
    Scope,
    Send,
    Session,
    Sessions,
)

HOST = "127.0.0.1:8080"


class Site:
    """An application behind the middleware, asked request by request."""

    def __init__(
        self, *, is_one_time: bool = True, images_from: tuple[str, ...] = (), host: str = HOST
    ) -> None:
        self.host = host
        self.sessions = Sessions(is_one_time=is_one_time)
        self.token = self.sessions.tokens["operator"]
        self.reached: list[str] = []
        self.passed: list[Session] = []
        self.now_s = 0.0
        self._access = Access(self._inside, self.sessions, frozenset({host}), lambda: self.now_s, images_from)

    async def _inside(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.reached.append(scope["path"])
        self.passed.append(scope[SESSION])
        await send({"type": "http.response.start", "status": 200, "headers": []})

    def ask(
        self,
        path: str = "/",
        *,
        kind: str = "http",
        method: str = "GET",
        by: str = "10.0.0.1",
        **headers: str,
    ) -> Message:
        """Return the first message of the answer to the address `by`; `headers` with _ for -."""
        sent: list[Message] = []

        async def send(message: Message) -> None:
            sent.append(message)

        async def receive() -> Message:
            raise AssertionError("a refused request is not read")

        named = {"host": self.host, **{name.replace("_", "-"): value for name, value in headers.items()}}
        path, _, query = path.partition("?")
        scope: dict[str, Any] = {
            "type": kind, "method": method, "path": path, "query_string": query.encode(), "client": (by, 1),
            "headers": [(name.encode(), value.encode()) for name, value in named.items()],
        }  # fmt: skip
        asyncio.run(self._access(scope, receive, send))
        return sent[0]

    def enter(self, token: str = "", more: str = "", by: str = "10.0.0.1") -> str:
        """Return the cookie that a token gives, by default the operator's."""
        headers = dict(self.ask(f"/?token={token or self.token}{more}", by=by)["headers"])
        return headers[b"set-cookie"].decode().partition(";")[0]


def test_the_token_is_exchanged_once_for_a_cookie() -> None:
    site = Site()
    cookie = site.enter()
    assert cookie.startswith(f"{COOKIE}_8080=")
    assert site.ask(f"/?token={site.token}")["status"] == 401
    assert site.reached == []
    assert site.ask("/", cookie=cookie)["status"] == 200


def test_two_dashboards_of_a_machine_keep_their_cookies_apart() -> None:
    sites = [Site(host=f"127.0.0.1:{port}") for port in (8080, 8081)]
    kept: dict[str, str] = {}  # as a browser keeps them: by name, for all ports of the host
    for site in sites:
        name, _, value = site.enter().partition("=")
        kept[name] = value
    cookies = "; ".join(f"{name}={value}" for name, value in kept.items())
    assert [site.ask("/", cookie=cookies)["status"] for site in sites] == [200, 200]


@pytest.mark.parametrize("token", ["", "guessed", "ü"])
def test_a_wrong_token_opens_nothing_and_spends_nothing(token: str) -> None:
    site = Site()
    assert site.ask(f"/?token={token}")["status"] == 401
    assert site.enter()


@pytest.mark.parametrize(
    ("status", "headers"),
    [
        (401, {"cookie": ""}),
        (401, {"cookie": f"{COOKIE}_8080=guessed"}),
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
    assert site.ask(f"/?token={site.token}", method="POST")["status"] == 401


def test_operators_and_viewers_have_tokens_and_names() -> None:
    site = Site(is_one_time=False)
    viewer = site.sessions.tokens["viewer"]
    for token, more in ((site.token, ""), (site.token, "&name=Ana%0A"), (viewer, "")):
        site.ask("/", cookie=site.enter(token, more, by="10.0.0.7"))
    assert [(session.role, session.name) for session in site.passed] == [
        ("operator", "operator 1 at 10.0.0.7"),
        ("operator", f"{printable('Ana' + chr(10))} at 10.0.0.7"),
        ("viewer", "viewer 1 at 10.0.0.7"),
    ]


def test_guesses_are_limited_by_address() -> None:
    site = Site(is_one_time=False)
    guesses = [site.ask(f"/?token=guess{i}")["status"] for i in range(WRONG_BURST + 5)]
    assert guesses == [401] * WRONG_BURST + [429] * 5
    assert site.ask(f"/?token={site.token}")["status"] == 429
    assert site.enter(by="10.0.0.2")
    site.now_s = 1.0 / WRONG_PER_S
    assert site.enter()


@pytest.mark.parametrize("origins", [(), ("https://tiles.example",)])
def test_the_policy_permits_pictures_of_the_tiles_alone(origins: tuple[str, ...]) -> None:
    site = Site(images_from=origins)
    (policy,) = [
        value.decode() for name, value in site.ask("/", cookie=site.enter())["headers"]
        if name == b"content-security-policy"
    ]  # fmt: skip
    rules = {rule.split()[0]: rule.split()[1:] for rule in policy.split(";")}
    outside = {rule: [place for place in places if "://" in place] for rule, places in rules.items()}
    assert {rule: places for rule, places in outside.items() if places} == (
        {"img-src": list(origins)} if origins else {}
    )
    assert rules["default-src"] == ["'self'"]
