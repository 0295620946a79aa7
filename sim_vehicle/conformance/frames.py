"""Frames beyond pymavlink's codec: malformed frames, and messages unknown to the codec."""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.conformance.assertions import Skip, result_name
from sim_vehicle.conformance.outgoing import COMMAND_CANCEL, COMMAND_CANCEL_EXTRA
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import STATION, ReceivedFrame, Source

COMPONENT_METADATA = 397
AVAILABLE_MODES, CURRENT_MODE = 435, 436
PROTOCOL_VERSION = 300


def frame(
    vehicle: VehicleUnderTest,
    message_id: int,
    payload: bytes,
    crc_extra: int,
    *,
    incompatible: int = 0,
    compatible: int = 0,
    source: Source = STATION,
) -> bytes:
    """Return an unsigned MAVLink 2 frame with any payload and flags."""
    codec = vehicle.sender.codec(source)
    head = struct.pack(
        "<BBBBBB", len(payload), incompatible, compatible, codec.seq, source[0], source[1]
    ) + message_id.to_bytes(3, "little")
    codec.seq = (codec.seq + 1) % 256
    crc = x25crc(head + payload + bytes([crc_extra])).crc
    return b"\xfd" + head + payload + struct.pack("<H", crc)


def command_cancel(vehicle: VehicleUnderTest, command: int) -> bytes:
    payload = struct.pack("<HBB", command, *vehicle.target)
    return frame(vehicle, COMMAND_CANCEL, payload, COMMAND_CANCEL_EXTRA)


def with_bad_crc(vehicle: VehicleUnderTest, message: Any) -> bytes:
    data = bytearray(vehicle.sender.pack(message))
    data[-1] ^= 0x5A
    return bytes(data)


def untrimmed(vehicle: VehicleUnderTest, message: Any, crc_extra: int) -> bytes:
    """Return the frame of a message with the trailing zeros that MAVLink 2 senders omit."""
    raw = vehicle.sender.pack(message)
    payload = raw[10:-2].ljust(message.unpacker.size, b"\0")
    return frame(vehicle, message.id, payload, crc_extra)


def request_fields(
    vehicle: VehicleUnderTest, message_id: int, layout: struct.Struct, *params: float
) -> tuple[Any, ...]:
    """Request a message unknown to the codec and return its fields; raise Skip if the vehicle refuses."""
    kind, mark = f"UNKNOWN_{message_id}", vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id, *params)
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise Skip(f"the vehicle does not send message {message_id} on request ({result_name(result)})")
    vehicle.expect(kind, mark=mark, description=f"message {message_id} after its request was accepted")
    return fields(vehicle.last[kind], layout)


def fields(entry: ReceivedFrame, layout: struct.Struct) -> tuple[Any, ...]:
    """Return the payload of a frame, padded with zeros, as the fields of a layout."""
    return layout.unpack(entry.payload.ljust(layout.size, b"\0")[: layout.size])
