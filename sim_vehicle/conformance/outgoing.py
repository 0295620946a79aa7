"""The frames in bytes that are about to be sent, found as a receiver could find them."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

LONGEST_FRAME = 280  # bytes of MAVLink 2, with its signature
COMMAND_CANCEL, COMMAND_CANCEL_EXTRA = 80, 14  # the codec does not know it
_CANCEL_TARGET = 2  # place of target_system in its payload
_HEADER_BYTES = {0xFE: 6, 0xFD: 10}
# Who a message is for; MANUAL_CONTROL alone has another name for it.
_TARGETS = ("target_system", "target")


@dataclass(frozen=True, slots=True)
class Sent:
    """One frame on its way: `target` is the system id it is for, 0 for everybody who hears it."""

    kind: str
    message: Any
    target: int


def sent_in(data: bytes, begin: int = 0) -> Iterator[Sent]:
    """Every frame with a right checksum that ends behind `begin`, wherever it starts.

    A receiver may begin to read anywhere, so frames within frames and behind garbage count. Signatures and
    flags do not matter: who ignores them obeys all the same.
    """
    for at, start in enumerate(data):
        head = _HEADER_BYTES.get(start)
        if head is None or at + head > len(data):
            continue
        end = at + head + data[at + 1] + 2
        if begin < end <= len(data):
            found = _frame(data[at:end], head)
            if found is not None:
                yield found


def _frame(raw: bytes, head: int) -> Sent | None:
    """A frame without its signature; None where its checksum is wrong or nobody knows the message."""
    number = raw[5] if head == _HEADER_BYTES[0xFE] else int.from_bytes(raw[7:10], "little")
    known = mavlink.mavlink_map.get(number)
    if known is None and number != COMMAND_CANCEL:
        return None
    extra = COMMAND_CANCEL_EXTRA if known is None else known.crc_extra
    if x25crc(raw[1:-2] + bytes([extra])).crc != struct.unpack("<H", raw[-2:])[0]:
        return None
    payload = raw[head:-2]
    if known is None:
        return Sent("COMMAND_CANCEL", None, payload.ljust(4, b"\0")[_CANCEL_TARGET])
    message = _decoded(number, payload, known)
    target = next((getattr(message, name) for name in _TARGETS if hasattr(message, name)), 0)
    return Sent(message.get_type(), message, int(target))


def _decoded(number: int, payload: bytes, known: Any) -> Any:
    """What the fields say to whoever reads them, framed so that the codec does."""
    fields = payload[: known.unpacker.size]
    body = bytes([len(fields), 0, 0, 0, 255, 190]) + number.to_bytes(3, "little") + fields
    crc = x25crc(body + bytes([known.crc_extra])).crc
    return mavlink.MAVLink(None).decode(bytearray(b"\xfd" + body + struct.pack("<H", crc)))
