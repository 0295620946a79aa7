"""Frames beyond pymavlink's codec: all frames in outgoing bytes, malformed frames, unknown messages."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.station.frames import STATION, ReceivedFrame, Sender, Source

LONGEST_FRAME = 280  # bytes of a signed MAVLink 2 frame
COMPONENT_METADATA, AVAILABLE_MODES, CURRENT_MODE, PROTOCOL_VERSION = 397, 435, 436, 300
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
            found = _outgoing(data[start:end], head)
            if found is not None:
                yield found


def _outgoing(raw: bytes, head: int) -> OutgoingFrame | None:
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
    # pymavlink decodes only whole frames; this one is without the flags and with the known fields only.
    whole = _frame((0, 0, 0, 255, 190), number, payload[: known.unpacker.size], known.crc_extra)
    message = mavlink.MAVLink(None).decode(bytearray(whole))
    target = next((getattr(message, name) for name in _TARGETS if hasattr(message, name)), 0)
    return OutgoingFrame(message.get_type(), message, int(target))


def _frame(head: tuple[int, int, int, int, int], number: int, payload: bytes, crc_extra: int) -> bytes:
    """Return an unsigned MAVLink 2 frame; `head`: both flags, sequence number, system and component id."""
    body = bytes([len(payload), *head]) + number.to_bytes(3, "little") + payload
    return b"\xfd" + body + struct.pack("<H", x25crc(body + bytes([crc_extra])).crc)


def frame(
    sender: Sender, number: int, payload: bytes, crc_extra: int, *,
    incompatible: int = 0, compatible: int = 0, source: Source = STATION,
) -> bytes:  # fmt: skip
    """Return the next frame of a station, with any payload and flags."""
    codec = sender.codec(source)
    head = incompatible, compatible, codec.seq, *source
    codec.seq = (codec.seq + 1) % 256
    return _frame(head, number, payload, crc_extra)


def fields(entry: ReceivedFrame, layout: struct.Struct) -> tuple[Any, ...]:
    """Return the payload of a frame, padded with zeros, as the fields of a layout."""
    return layout.unpack(entry.payload.ljust(layout.size, b"\0")[: layout.size])
