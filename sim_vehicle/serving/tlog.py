"""Telemetry logs as ground stations keep them: before each message its time [us] in 8 bytes, big-endian."""

import struct
from typing import BinaryIO

from sim_vehicle.epoch import EPOCH_US


class Tlog:
    """Writes one log; `file` is owned by the caller."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def write(self, frame: bytes, now: float) -> None:
        """One whole MAVLink frame at `now` [s of simulated time]."""
        self._file.write(struct.pack(">Q", EPOCH_US + round(now * 1e6)) + frame)
