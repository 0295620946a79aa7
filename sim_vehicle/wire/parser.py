"""Parser of one byte stream."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import decoded


class Parser:
    """Parser of a stream in pieces of any length, with BAD_DATA for unreadable bytes."""

    def __init__(self) -> None:
        self._codec = mavlink.MAVLink(None)
        self._codec.robust_parsing = True

    def feed(self, data: bytes) -> list[Any]:
        """Return the messages that `data` completes."""
        codec = self._codec
        messages = codec.parse_buffer(data) or []
        # pymavlink frees read bytes only when a stream pauses between two frames. A stream without pauses
        # would stay in memory.
        del codec.buf[: codec.buf_index]
        codec.buf_index = 0
        return [decoded(message) for message in messages]

    @property
    def waiting_bytes(self) -> int:
        """Number of bytes of the incomplete message."""
        return len(self._codec.buf)
