"""Parser of one byte stream."""

import struct
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.wire.frame import MAVLINK1, header_bytes

COMMAND_CANCEL, _CANCEL_EXTRA = 80, b"\x0e"  # message id and CRC_EXTRA, which the dialect lacks
_CANCEL = struct.Struct("<HBB")
_UNKNOWN_CANCEL = f"UNKNOWN_{COMMAND_CANCEL}"


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
        return [_decode_if_cancel(message) for message in messages]

    @property
    def waiting_bytes(self) -> int:
        """Number of bytes of the incomplete message."""
        return len(self._codec.buf)


class CommandCancel(mavlink.MAVLink_message):  # type: ignore[misc]
    """COMMAND_CANCEL, which pymavlink's dialect lacks."""

    def __init__(self, target_system: int, target_component: int, command: int) -> None:
        super().__init__(COMMAND_CANCEL, "COMMAND_CANCEL")
        self.target_system, self.target_component, self.command = target_system, target_component, command

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = _CANCEL.pack(self.command, self.target_system, self.target_component)
        return bytes(self._pack(mav, _CANCEL_EXTRA[0], payload, force_mavlink1=force_mavlink1))


def _decode_if_cancel(message: Any) -> Any:
    """Return COMMAND_CANCEL decoded, or any other message unchanged."""
    return _decode_cancel(message) or message if message.get_type() == _UNKNOWN_CANCEL else message


def _decode_cancel(unknown: Any) -> CommandCancel | None:
    """Return COMMAND_CANCEL decoded from its frame; None if the checksum is wrong."""
    frame = bytes(unknown.get_msgbuf())
    length, start = frame[1], header_bytes(frame)
    payload = frame[start : start + length]
    crc = mcrf4xx(frame[1 : start + length] + _CANCEL_EXTRA)
    if struct.unpack_from("<H", frame, start + length)[0] != crc:
        return None
    command, system, component = _CANCEL.unpack(payload[: _CANCEL.size].ljust(_CANCEL.size, b"\0"))
    cancel = CommandCancel(system, component, command)
    flags = (0, 0) if frame[0] == MAVLINK1 else (frame[2], frame[3])
    sender = frame[start - 4 : start - 1] if frame[0] == MAVLINK1 else frame[4:7]
    cancel._header = mavlink.MAVLink_header(COMMAND_CANCEL, *flags, length, *sender)
    cancel._msgbuf = bytearray(frame)
    return cancel
