"""The process of the dashboard: it reads its sources, and serves its page on this machine."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from dataclasses import dataclass

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from swarmctl.dashboard import page
from swarmctl.dashboard.access import Access, Sessions
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.orders_panel import Send

HOST = "127.0.0.1"
KEPT_S = 60.0
"""time for which the page of an unheard browser is kept; after that the browser loads it anew [s]

A browser on a loaded machine can be silent for many seconds. A new page has no open dialog and no choices."""


@dataclass(frozen=True, slots=True)
class Source:
    """A timeline that grows while `run` runs."""

    timeline: Timeline
    run: Callable[[], Coroutine[None, None, None]]


async def serve(
    sources: Mapping[str, Source], port: int, announce: Callable[[str], None], send: Send | None = None
) -> None:
    """Serve sources, by title, until cancelled; `announce` gets the address, and `send` sends commands.

    Raises OSError if the port is in use.
    """
    timelines = {title: source.timeline for title, source in sources.items()}

    async def run() -> None:
        async with asyncio.TaskGroup() as tasks:
            for source in sources.values():
                tasks.create_task(source.run())

    await serve_page(lambda: page.register(timelines, send), port, announce, run)


async def serve_page(
    register: Callable[[], None],
    port: int,
    announce: Callable[[str], None],
    run: Callable[[], Coroutine[None, None, None]] | None = None,
) -> None:
    """Serve the page that `register` adds, with the task `run` beside it."""
    listener = socket.create_server((HOST, port))
    port = listener.getsockname()[1]
    sessions = Sessions()
    hosts = frozenset(f"{name}:{port}" for name in (HOST, "localhost"))

    @contextlib.asynccontextmanager
    async def reading(_app: FastAPI) -> AsyncIterator[None]:
        task = None if run is None else asyncio.create_task(run())
        try:
            yield
        finally:
            if task is not None:
                task.cancel()

    application = FastAPI(lifespan=reading, docs_url=None, redoc_url=None, openapi_url=None)
    register()
    ui.run_with(application, dark=None, show_welcome_message=False, reconnect_timeout=KEPT_S)
    application.add_middleware(Access, sessions=sessions, hosts=hosts)
    config = uvicorn.Config(application, log_level="warning", ws_max_size=1 << 20, lifespan="on")
    announce(f"http://{HOST}:{port}/?token={sessions.token}")
    await uvicorn.Server(config).serve([listener])
