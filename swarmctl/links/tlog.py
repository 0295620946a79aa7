"""The .tlog of one vehicle, as MAVExplorer, Mission Planner and QGroundControl read it."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

_TIME = struct.Struct(">Q")


class TlogWriter:
    """Big-endian microseconds since 1970 before every frame, both directions in one file.

    A disk that takes no more ends the log, which is said once, and not the flight.
    """

    def __init__(self, path: Path, wall_time_us: Callable[[], int], say: Callable[[str], None]) -> None:
        self._path = path
        self._file = path.open("wb", buffering=1 << 16)
        self._wall_time_us = wall_time_us
        self._say = say
        self._is_ended = False

    def write(self, frame: bytes) -> None:
        if not self._is_ended:
            with self._failing():
                self._file.write(_TIME.pack(self._wall_time_us()) + frame)

    def flush(self) -> None:
        """What was written is the operating system's now, and outlives this process."""
        if not self._is_ended:
            with self._failing():
                self._file.flush()

    def close(self) -> None:
        with self._failing():
            self._file.close()

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not self._is_ended:
                self._is_ended = True
                self._say(f"{self._path}: {error.strerror or error}; this log ends here, the flight goes on")
