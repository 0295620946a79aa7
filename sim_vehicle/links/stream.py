"""A connected byte stream on the event loop, with a limited backlog of whole frames."""

import asyncio
from collections.abc import Callable

from sim_vehicle.links.base import RECEIVE_BYTES, Batch

STALLED_S = 30.0  # time without progress after which a connection is closed


class Stream:
    """A stream that drops and counts chunks of frames beyond its backlog limit."""

    def __init__(
        self,
        file: int,
        read: Callable[[int], bytes],
        write: Callable[[memoryview], int],
        *,
        backlog_bytes: int,
        received: Callable[[bytes], None],
        ended: Callable[[str], None],
    ) -> None:
        """Begin to read from the descriptor `file`; `ended` receives the reason of the stream's end, once."""
        self.dropped = 0
        self._file, self._read, self._write = file, read, write
        self._limit = backlog_bytes
        self._received, self._ended = received, ended
        self._backlog = bytearray()
        self._progress_s = 0.0
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(file, self._readable)

    def _readable(self) -> None:
        try:
            data = self._read(RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error.strerror or str(error))
            return
        if data:
            self._received(data)
        else:
            self._end("closed by the other end")

    def send(self, batch: Batch) -> None:
        """Send a batch in order; drop chunks beyond the backlog limit."""
        if not self._open:
            return
        had_backlog = bool(self._backlog)
        for _, data in batch:
            if len(self._backlog) + len(data) > self._limit:
                self.dropped += 1
            else:
                self._backlog += data
        if not had_backlog:
            self._progress_s = self._loop.time()
            self._flush()
        elif self._loop.time() - self._progress_s > STALLED_S:
            self._end(f"the other end has read nothing for {STALLED_S:.0f} s")

    def _flush(self) -> None:
        try:
            with memoryview(self._backlog) as view:
                written = self._write(view)
        except BlockingIOError:
            written = 0
        except OSError as error:
            self._end(error.strerror or str(error))
            return
        if written:
            self._progress_s = self._loop.time()
            del self._backlog[:written]
        if self._backlog:
            self._loop.add_writer(self._file, self._flush)
        else:
            self._loop.remove_writer(self._file)

    def _end(self, reason: str) -> None:
        if self._open:
            self.detach()
            self._ended(reason)

    def detach(self) -> None:
        """Stop using the descriptor; the owner closes it."""
        if self._open:
            self._open = False
            self._loop.remove_reader(self._file)
            self._loop.remove_writer(self._file)
