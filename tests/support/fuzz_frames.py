"""Broken frames."""

import random
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink


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
