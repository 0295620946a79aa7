"""Writer of a vehicle's .tlog for MAVExplorer, Mission Planner and QGroundControl."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

_TIME = struct.Struct(">Q")


class TlogWriter:
    """Log of frames in both directions: the time [µs since 1970, 64 bits, big-endian], then the frame.

    An error such as a full disk ends the log, with one message; the flight continues.
    """

    def __init__(self, path: Path, wall_time_us: Callable[[], int], say: Callable[[str], None]) -> None:
        self._path = path
        self._wall_time_us = wall_time_us
        self._say = say
        self._is_ended = False
        self._file: BinaryIO = io.BytesIO()
        with self._ending_at_error():
            self._file = path.open("wb", buffering=1 << 16)

    def write(self, frame: bytes) -> None:
        if not self._is_ended:
            try:
                self._file.write(_TIME.pack(self._wall_time_us()) + frame)
            except OSError as error:
                self._end(error)

    def flush(self) -> None:
        """Pass all written bytes to the operating system, so that a crash of this process loses none."""
        if not self._is_ended:
            with self._ending_at_error():
                self._file.flush()

    def close(self) -> None:
        with self._ending_at_error():
            self._file.close()

    @contextlib.contextmanager
    def _ending_at_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        if not self._is_ended:
            self._is_ended = True
            reason = error.strerror or error
            self._say(f"{self._path}: {reason}; this log ends, the flight continues [log-ended]")
