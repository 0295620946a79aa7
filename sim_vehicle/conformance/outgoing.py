"""The frames that a receiver could find in outgoing bytes."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

LONGEST_FRAME = 280  # bytes of a signed MAVLink 2 frame
COMMAND_CANCEL, COMMAND_CANCEL_EXTRA = 80, 14  # unknown to pymavlink's codec
_CANCEL_TARGET = 2  # offset of target_system in the payload of COMMAND_CANCEL
_HEADER_BYTES = {0xFE: 6, 0xFD: 10}
# Names of the target field; only MANUAL_CONTROL uses the second.
_TARGETS = ("target_system", "target")


@dataclass(frozen=True, slots=True)
class OutgoingFrame:
    """One outgoing frame."""

    kind: str  # name of the message
    message: Any  # None for COMMAND_CANCEL
    target: int  # system id; 0: all receivers


def frames_in(data: bytes, begin: int = 0) -> Iterator[OutgoingFrame]:
    """Yield each known message that has a correct checksum and ends after the index `begin`.

    A receiver may start reading at any byte. The search therefore tries every byte, and also finds a frame
    inside another frame. Signatures and flags are ignored, because some receivers ignore them.
    """
    for start, byte in enumerate(data):
        head = _HEADER_BYTES.get(byte)
        if head is None or start + head > len(data):
            continue
        end = start + head + data[start + 1] + 2
        if begin < end <= len(data):
            found = _frame(data[start:end], head)
            if found is not None:
                yield found


def _frame(raw: bytes, head: int) -> OutgoingFrame | None:
    """Decode a frame without a signature; return None for a wrong checksum or an unknown message."""
    number = raw[5] if head == _HEADER_BYTES[0xFE] else int.from_bytes(raw[7:10], "little")
    known = mavlink.mavlink_map.get(number)
    if known is None and number != COMMAND_CANCEL:
        return None
    extra = COMMAND_CANCEL_EXTRA if known is None else known.crc_extra
    if x25crc(raw[1:-2] + bytes([extra])).crc != struct.unpack("<H", raw[-2:])[0]:
        return None
    payload = raw[head:-2]
    if known is None:
        return OutgoingFrame("COMMAND_CANCEL", None, payload.ljust(4, b"\0")[_CANCEL_TARGET])
    message = _decoded(number, payload, known)
    target = next((getattr(message, name) for name in _TARGETS if hasattr(message, name)), 0)
    return OutgoingFrame(message.get_type(), message, int(target))


def _decoded(number: int, payload: bytes, known: Any) -> Any:
    """Return the message of a payload, decoded in a new frame because pymavlink decodes only frames."""
    fields = payload[: known.unpacker.size]
    body = bytes([len(fields), 0, 0, 0, 255, 190]) + number.to_bytes(3, "little") + fields
    crc = x25crc(body + bytes([known.crc_extra])).crc
    return mavlink.MAVLink(None).decode(bytearray(b"\xfd" + body + struct.pack("<H", crc)))
