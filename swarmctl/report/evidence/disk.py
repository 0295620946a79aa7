"""The disk below the file: what is written is made to outlive a loss of power, and nobody waits for it."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor


class Disk:
    """Syncs one open file. One sync at a time; what is asked for meanwhile is one more after it."""

    def __init__(self, fileno: int, failed: Callable[[OSError], None], *, in_thread: bool) -> None:
        """`in_thread`: in one of its own; then all this is called, and calls `failed`, in a running loop."""
        self._fileno = fileno
        self._failed = failed
        self._pool = ThreadPoolExecutor(1, "evidence") if in_thread else None
        self._running: Future[None] | None = None
        self._told: asyncio.Future[None] | None = None
        """as `_running`, for who waits for it in the loop"""
        self._again = False

    def sync(self) -> None:
        """Begin to sync all that was written; without a thread of its own, do it."""
        if self._pool is None:
            self._sync_here()
        elif self._told is None:
            self._begin(self._pool)
        else:
            self._again = True

    async def idle(self) -> None:
        """Until every sync that was asked for is done."""
        while self._told is not None:
            await asyncio.wait((self._told,))

    def close(self) -> None:
        """Wait for what is under way, sync the rest. The file is closed after this, not before."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
            # The loop may be told of it too late.
            if self._running is not None and isinstance(error := self._running.exception(), OSError):
                self._failed(error)
        self._sync_here()

    def _begin(self, pool: ThreadPoolExecutor) -> None:
        self._again = False
        self._running = pool.submit(os.fsync, self._fileno)
        self._told = asyncio.wrap_future(self._running)
        self._told.add_done_callback(self._done)

    def _done(self, told: asyncio.Future[None]) -> None:
        self._told = None
        error = None if told.cancelled() else told.exception()
        if self._pool is None:
            return  # `close` has seen to it
        if isinstance(error, OSError):
            self._failed(error)
        elif error is not None:
            raise error
        elif self._again:
            self._begin(self._pool)

    def _sync_here(self) -> None:
        try:
            os.fsync(self._fileno)
        except OSError as error:
            self._failed(error)
