"""Frames beyond pymavlink's codec: all messages in outgoing bytes, and malformed frames."""

import struct
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.definitions import CRC_EXTRA, HEADER_BYTES, MAVLINK1, decoded
from sim_vehicle.station.frames import STATION, Sender, Source

LONGEST_FRAME = 280  # bytes of a signed MAVLink 2 frame


def messages_in(data: bytes, begin: int) -> Iterator[Any]:
    """Yield each known message that has a correct checksum and ends after the index `begin`.

    A receiver may start reading at any byte. The search therefore tries every byte, and also finds a frame
    inside another frame. Signatures and flags are ignored, because some receivers ignore them.
    """
    for start, byte in enumerate(data):
        head = HEADER_BYTES.get(byte)
        if head is None or start + head > len(data):
            continue
        end = start + head + data[start + 1] + 2
        if begin < end <= len(data):
            found = _message(data[start:end])
            if found is not None:
                yield found


def _message(raw: bytes) -> Any | None:
    """Decode a frame without a signature; return None for a wrong checksum or an unknown message."""
    number = raw[5] if raw[0] == MAVLINK1 else int.from_bytes(raw[7:10], "little")
    extra = CRC_EXTRA.get(number)
    if extra is None or x25crc(raw[1:-2] + bytes([extra])).crc != struct.unpack("<H", raw[-2:])[0]:
        return None
    # pymavlink rejects some flags; this frame has none.
    whole = _frame((0, 0, 0, 255, 190), number, raw[HEADER_BYTES[raw[0]] : -2], extra)
    return decoded(mavlink.MAVLink(None).decode(bytearray(whole)))


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
