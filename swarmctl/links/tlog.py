"""The .tlog of one vehicle, as MAVExplorer, Mission Planner and QGroundControl read it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

_TIME = struct.Struct(">Q")


class TlogWriter:
    """Big-endian microseconds since 1970 before every frame, both directions in one file."""

    def __init__(self, path: Path, wall_time_us: Callable[[], int]) -> None:
        self._file = path.open("wb", buffering=1 << 16)
        self._wall_time_us = wall_time_us

    def write(self, frame: bytes) -> None:
        self._file.write(_TIME.pack(self._wall_time_us()) + frame)

    def flush(self) -> None:
        """What was written is the operating system's now, and outlives this process."""
        self._file.flush()

    def close(self) -> None:
        self._file.close()
