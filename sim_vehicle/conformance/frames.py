"""Frames the codec does not make: bent ones for the robustness checks, and messages it does not know."""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.conformance.facts import Heard
from sim_vehicle.conformance.outgoing import COMMAND_CANCEL, COMMAND_CANCEL_EXTRA
from sim_vehicle.conformance.peer import STATION, Peer
from sim_vehicle.conformance.words import Skip, result_name

COMPONENT_METADATA = 397
AVAILABLE_MODES, CURRENT_MODE = 435, 436
PROTOCOL_VERSION = 300


def frame(
    peer: Peer,
    message_id: int,
    payload: bytes,
    crc_extra: int,
    *,
    incompatible: int = 0,
    compatible: int = 0,
    source: tuple[int, int] = STATION,
) -> bytes:
    """A MAVLink 2 frame around any payload."""
    codec = peer.codec(source)
    head = struct.pack(
        "<BBBBBB", len(payload), incompatible, compatible, codec.seq, source[0], source[1]
    ) + message_id.to_bytes(3, "little")
    codec.seq = (codec.seq + 1) % 256
    crc = x25crc(head + payload + bytes([crc_extra])).crc
    return b"\xfd" + head + payload + struct.pack("<H", crc)


def command_cancel(peer: Peer, command: int) -> bytes:
    payload = struct.pack("<HBB", command, *peer.target)
    return frame(peer, COMMAND_CANCEL, payload, COMMAND_CANCEL_EXTRA)


def with_bad_crc(peer: Peer, message: Any) -> bytes:
    data = bytearray(peer.pack(message))
    data[-1] ^= 0x5A
    return bytes(data)


def untrimmed(peer: Peer, message: Any, crc_extra: int) -> bytes:
    """The message's frame with the zero bytes that a MAVLink 2 sender leaves out."""
    raw = peer.pack(message)
    payload = raw[10:-2].ljust(message.unpacker.size, b"\0")
    return frame(peer, message.id, payload, crc_extra)


def requested(peer: Peer, message_id: int, layout: struct.Struct, *params: float) -> tuple[Any, ...]:
    """Fields, in the order they travel, of a message by REQUEST_MESSAGE that the codec does not know.

    Skip where the vehicle does not offer it.
    """
    kind, mark = f"UNKNOWN_{message_id}", peer.mark()
    result = peer.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id, *params)
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise Skip(f"does not send message {message_id} on request ({result_name(result)})")
    peer.expect(kind, mark=mark, what=f"message {message_id} after its request was accepted")
    return fields(peer.last[kind], layout)


def fields(entry: Heard, layout: struct.Struct) -> tuple[Any, ...]:
    """The payload of a frame, with its trailing zeros, by a layout."""
    return layout.unpack(entry.payload.ljust(layout.size, b"\0")[: layout.size])
