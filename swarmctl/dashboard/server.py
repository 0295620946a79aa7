"""The process of the dashboard: it reads its sources, and serves its page on this machine or over TLS."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from ipaddress import ip_address
from pathlib import Path

import msgspec
import uvicorn
from fastapi import FastAPI
from nicegui import ui

from swarmctl.dashboard import page
from swarmctl.dashboard.access import Access, Sessions
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.orders_panel import Send
from swarmctl.dashboard.tiles import Tiles
from swarmctl.security.files import KeyringError, hosts_of, read_certificate

LOOPBACK = ("127.0.0.1", "localhost")
KEPT_S = 60.0
"""time for which the page of an unheard browser is kept; after that the browser loads it anew [s]

A browser on a loaded machine can be silent for many seconds. A new page has no open dialog and no choices."""
MAX_MESSAGE_BYTES = 1 << 20
"""largest accepted message of a browser's WebSocket"""


class CannotServe(ValueError):
    """An address without the protection that it needs; the text says what to do."""


class CannotListen(Exception):
    """A server socket that cannot be created; the text has the address and the reason."""


class Where(msgspec.Struct, frozen=True):
    """The address of the page, and the certificate and key for TLS; other machines reach it over TLS only."""

    host: str = LOOPBACK[0]
    port: int = 0
    certificate: Path | None = None
    key: Path | None = None

    def names(self) -> tuple[str, ...]:
        """Return the names of this machine for browsers. Raises CannotServe."""
        if self.certificate is None or self.key is None:
            if self.host not in LOOPBACK:
                raise CannotServe(
                    f"other machines reach {self.host}, where the page needs TLS: give --cert and "
                    "--key, or a --config with communication.keys [dashboard-needs-tls]"
                )
            return LOOPBACK
        try:
            names = hosts_of(read_certificate(self.certificate))
            ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(self.certificate, self.key)
        except (KeyringError, OSError) as error:
            raise CannotServe(f"the certificate cannot be used: {error} [dashboard-certificate]") from error
        if self.host not in names and not _is_wildcard(self.host):
            raise CannotServe(
                f"{self.certificate} does not name {self.host}, so browsers would refuse it; with the "
                f"swarm's authority: `swarmctl keys --host operator={self.host}` [dashboard-certificate]"
            )
        return names if _is_wildcard(self.host) else (self.host, *(n for n in names if n != self.host))


def _is_wildcard(host: str) -> bool:
    try:
        return ip_address(host).is_unspecified
    except ValueError:
        return False


class GrowingTimeline(msgspec.Struct, frozen=True):
    """A timeline that grows while `run` runs; if reading fails, `run` puts the reason into its text."""

    timeline: Timeline
    run: Callable[[], Coroutine[None, None, None]]


def in_background(run: Coroutine[None, None, None]) -> asyncio.Task[None]:
    """Start a task that nothing waits for; an exception goes to the loop's handler at once."""

    def report(task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            text = "a source of the dashboard failed; the page shows the data up to now"
            task.get_loop().call_exception_handler({"message": text, "exception": error, "task": task})

    task = asyncio.create_task(run)
    task.add_done_callback(report)
    return task


async def serve(
    sources: Mapping[str, GrowingTimeline],
    where: Where,
    announce: Callable[[str, str], None],
    send: Send | None = None,
    tiles: Tiles | None = None,
) -> None:
    """Serve sources, by title, until cancelled; `send` sends commands, and `announce` gets role and address.

    Raises CannotListen and CannotServe.
    """
    timelines = {title: source.timeline for title, source in sources.items()}

    async def run() -> None:
        async with asyncio.TaskGroup() as tasks:
            for source in sources.values():
                tasks.create_task(source.run())

    def register(sessions: Sessions) -> None:
        page.register(timelines, sessions, send, tiles)

    await serve_page(register, where, announce, run, tiles)


async def serve_page(
    register: Callable[[Sessions], None],
    where: Where,
    announce: Callable[[str, str], None],
    run: Callable[[], Coroutine[None, None, None]] | None = None,
    tiles: Tiles | None = None,
) -> None:
    """Serve the page that `register` adds, with the task `run` beside it. Raises as `serve`."""
    names = where.names()
    is_encrypted = where.certificate is not None
    try:
        listener = socket.create_server((where.host, where.port))
    except OSError as error:
        raise CannotListen(
            f"{where.host}:{where.port}: {error.strerror or error}; choose another --port or --listen"
        ) from error
    port = listener.getsockname()[1]
    sessions = Sessions(is_one_time=not is_encrypted)

    @contextlib.asynccontextmanager
    async def reading(_app: FastAPI) -> AsyncIterator[None]:
        task = None if run is None else in_background(run())
        try:
            yield
        finally:
            if task is not None:
                task.cancel()

    application = FastAPI(lifespan=reading, docs_url=None, redoc_url=None, openapi_url=None)
    if tiles is not None:
        tiles.add_to(application)
    register(sessions)
    ui.run_with(application, dark=None, show_welcome_message=False, reconnect_timeout=KEPT_S)
    application.add_middleware(
        Access,
        sessions=sessions,
        hosts=frozenset(f"{name}:{port}" for name in names),
        clock=time.monotonic,
        images_from=() if tiles is None else tiles.origins,
    )
    config = uvicorn.Config(
        application,
        log_level="warning",
        ws_max_size=MAX_MESSAGE_BYTES,
        lifespan="on",
        ssl_certfile=where.certificate,
        ssl_keyfile=where.key,
    )
    for role, token in sessions.tokens.items():
        announce(role, f"{'https' if is_encrypted else 'http'}://{names[0]}:{port}/?token={token}")
    await uvicorn.Server(config).serve([listener])
