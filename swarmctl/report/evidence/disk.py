"""Syncs of a file to the disk, so that its content survives a loss of power."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor


class FileSync:
    """Syncs of one open file, one at a time; all requests during a sync share one further sync."""

    def __init__(self, fileno: int, on_error: Callable[[OSError], None], *, in_thread: bool) -> None:
        """`in_thread`: sync in a separate thread; `sync` then needs a running event loop."""
        self._fileno = fileno
        self._on_error = on_error
        self._pool = ThreadPoolExecutor(1, "evidence") if in_thread else None
        self._running: Future[None] | None = None
        self._future: asyncio.Future[None] | None = None
        """the running sync as a future of the loop"""
        self._is_sync_requested = False

    def sync(self) -> None:
        """Begin a sync; if there is no separate thread, return after the end of the sync."""
        if self._pool is None:
            self._sync_here()
        elif self._future is None:
            self._begin(self._pool)
        else:
            self._is_sync_requested = True

    async def wait_idle(self) -> None:
        """Wait until every requested sync is done or one has failed."""
        while self._future is not None:
            await asyncio.wait((self._future,))

    def close(self) -> None:
        """Wait for the running sync, and sync once more. The file must still be open."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
            # The loop may call `_done` after the end of this method.
            if self._running is not None and isinstance(error := self._running.exception(), OSError):
                self._on_error(error)
        self._sync_here()

    def _begin(self, pool: ThreadPoolExecutor) -> None:
        self._is_sync_requested = False
        self._running = pool.submit(os.fsync, self._fileno)
        self._future = asyncio.wrap_future(self._running)
        self._future.add_done_callback(self._done)

    def _done(self, future: asyncio.Future[None]) -> None:
        self._future = None
        error = None if future.cancelled() else future.exception()
        if self._pool is None:
            return  # `close` handles the error
        if isinstance(error, OSError):
            self._on_error(error)
        elif error is not None:
            raise error
        elif self._is_sync_requested:
            self._begin(self._pool)

    def _sync_here(self) -> None:
        try:
            os.fsync(self._fileno)
        except OSError as error:
            self._on_error(error)
