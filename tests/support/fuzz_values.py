"""Values for fields of messages, mostly at their limits, and broken frames."""

import math
import random
import struct
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG

FLOATS = (
    0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 4.0, 12.0, 90.0, 180.0, 255.0, 1e-45, 1.2e-38, 65_535.0,
    21_196.0, 2.0**31, -(2.0**31), 2.0**32, 1e9, -1e9, 3.4e38, -3.4e38, math.nan, math.inf, -math.inf,
)  # fmt: skip
TARGETS = (0, 1, 1, 1, 1, 2, 2, 3, 255)
COMPONENTS = (0, 1, 1, 1, 1, 190, 255)
DEAFENING = frozenset({"SYSID_ENFORCE"})  # makes a vehicle ignore other stations, as specified


def place(source: random.Random) -> tuple[int, int]:
    """Return a position, mostly nearby, else anywhere."""
    if source.random() < 0.7:
        return tuple(round((at + source.uniform(-1e-3, 1e-3)) * 1e7) for at in (LAT_DEG, LON_DEG))  # type: ignore[return-value]
    return int(number("int32_t", source)), int(number("int32_t", source))


def number(kind: str, source: random.Random) -> float | int:
    """Return a value of a field's type, often at its limit."""
    if kind in ("float", "double"):
        if source.random() < 0.2:
            return float(struct.unpack("<f", source.randbytes(4))[0])
        return source.choice(FLOATS)
    kind = kind.removesuffix("_mavlink_version")
    bits = int(kind.removesuffix("_t").lstrip("uint"))
    signed = not kind.startswith("u")
    lowest, highest = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return source.choice((lowest, highest, 0, 1, 2, 3, source.randint(lowest, highest)))


def values(message: Any, source: random.Random) -> Iterator[Any]:
    """Yield values for all fields of a message class, mostly addressed to an existing vehicle."""
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    for field, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        if field == "target_system":
            yield source.choice((0, 1, 1, 1, 2, 3, 255))
        elif field == "target_component":
            yield source.choice((0, 1, 1, 1, 190, 255))
        elif kind == "char":
            yield source.randbytes(source.randint(0, max(lengths[field], 1)))
        elif lengths[field]:
            yield [number(kind, source) for _ in range(lengths[field])]
        else:
            yield number(kind, source)


def random_message(message: Any, source: random.Random) -> Any:
    return message(*values(message, source))


def spoilt_frame(frame: bytes, source: random.Random) -> bytes:
    """Return a frame with one defect."""
    cut = bytearray(frame)
    choice = source.randrange(7)
    if choice == 0:  # truncated
        return bytes(cut[: source.randrange(len(cut))])
    if choice == 1:  # a wrong checksum
        cut[-1] ^= source.randint(1, 255)
    elif choice == 2:  # bits flipped anywhere
        for _ in range(source.randint(1, 4)):
            cut[source.randrange(len(cut))] ^= 1 << source.randrange(8)
    elif choice == 3:  # a wrong length
        cut[1] = source.randint(0, 255)
    elif choice == 4:  # unknown flags, or an invalid signature
        cut[2] = source.randint(0, 255)
    elif choice == 5:  # the id of another message
        cut[7:10] = source.randbytes(3)
    else:  # a signature of random bytes
        body = bytes(cut[:2]) + b"\x01" + bytes(cut[3:-2])
        cut = sealed(body, crc_extra(int.from_bytes(body[7:10], "little"))) + bytearray(source.randbytes(13))
    return bytes(cut)


def crc_extra(message_id: int) -> int:
    """Return CRC_EXTRA of a message of the dialect; 0 for others."""
    return int(mavlink.mavlink_map[message_id].crc_extra) if message_id in mavlink.mavlink_map else 0


def sealed(body: bytes, seed: int) -> bytearray:
    """Return a MAVLink 2 frame with its checksum."""
    crc = mavlink.x25crc(bytearray(body[1:]) + bytes([seed])).crc
    return bytearray(body + struct.pack("<H", crc))


def odd_length(message_id: int, source: random.Random) -> bytes:
    """Return a frame with a correct checksum and a payload of the wrong length."""
    payload = source.randbytes(source.choice((0, 1, 2, 5, 9, 33, 100, 254, 255)))
    sequence, system = source.randint(0, 255), source.randint(0, 255)
    head = struct.pack("<BBBBBBB", 0xFD, len(payload), 0, 0, sequence, system, 190)
    return bytes(sealed(head + message_id.to_bytes(3, "little") + payload, crc_extra(message_id)))
