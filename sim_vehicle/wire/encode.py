"""MAVLink 2 frames for a whole fleet at once: columns of numbers in, one frame per vehicle out.

Message layouts (wire order, types, CRC_EXTRA) come from pymavlink. The payloads of all vehicles are one
structured array. A stream costs a few array operations and about 1 us per frame; pymavlink's objects, packing
and Python CRC cost far more.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.wire.frame import MAVLINK2

MAGIC = bytes([MAVLINK2])
# length, incompatibility flags, compatibility flags, sequence, system, component, 3 bytes of the message id
_HEADER = struct.Struct("<BBBBBBBBB")
_CRC = struct.Struct("<H")
_NUMPY_TYPES = {
    "uint8_t": "u1",
    "int8_t": "i1",
    "uint16_t": "<u2",
    "int16_t": "<i2",
    "uint32_t": "<u4",
    "int32_t": "<i4",
    "uint64_t": "<u8",
    "int64_t": "<i8",
    "float": "<f4",
    "double": "<f8",
    "uint8_t_mavlink_version": "u1",
}
# Smallest and largest float that each integer type can hold.
_LIMITS = {
    np.dtype(kind).str: (float(np.iinfo(kind).min), np.nextafter(float(np.iinfo(kind).max) + 1, 0))
    for kind in (np.uint8, np.int8, np.uint16, np.int16, np.uint32, np.int32, np.uint64, np.int64)
}
Payloads = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of one message; `dtype` has the fields of the payload in wire order, without padding."""

    message_id: int
    name: str
    crc_extra: bytes
    dtype: np.dtype[Any]


def layout_of(message_id: int) -> Layout:
    """Return the layout of a message of the dialect; raise KeyError if the id is unknown."""
    message = mavlink.mavlink_map[message_id]
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    fields: list[Any] = []
    for name in message.ordered_fieldnames:
        length = lengths[name]
        if types[name] == "char":
            fields.append((name, f"S{max(length, 1)}"))
        elif length:
            fields.append((name, _NUMPY_TYPES[types[name]], (length,)))
        else:
            fields.append((name, _NUMPY_TYPES[types[name]]))
    return Layout(message_id, message.msgname, bytes([message.crc_extra]), np.dtype(fields))


class DefinedMessage(mavlink.MAVLink_message):  # type: ignore[misc]
    """A message that the dialect lacks, defined by its layout; packs like pymavlink's messages."""

    def __init__(self, layout: Layout, **fields: Any) -> None:
        super().__init__(layout.message_id, layout.name)
        self._layout = layout
        self._payload = pack_payloads(layout, 1, fields).tobytes()

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        extra = self._layout.crc_extra[0]
        return bytes(self._pack(mav, extra, self._payload, force_mavlink1=force_mavlink1))


def pack_payloads(layout: Layout, n: int, columns: Mapping[str, Any]) -> Payloads:
    """Return the payloads of `n` vehicles; fields without a column are 0.

    A column is a scalar or an array, (n,) or (n, length). Floats for an integer field are rounded and limited
    to the field's range; NaN becomes 0.
    """
    payloads = np.zeros(n, layout.dtype)
    for name, values in columns.items():
        base = layout.dtype[name].base
        array = np.asarray(values)
        if base.kind in "iu" and array.dtype.kind == "f":
            lowest, highest = _LIMITS[base.str]
            array = np.minimum(np.maximum(np.rint(array), lowest), highest)
            if np.count_nonzero(np.isnan(array)):
                array = np.nan_to_num(array)
        payloads[name] = array
    return payloads


def frames(
    layout: Layout, payloads: Payloads, systems: Sequence[int], sequences: Sequence[int], component: int
) -> list[bytes]:
    """Return one unsigned MAVLink 2 frame per payload, without the payload's trailing zeros."""
    size, blob = layout.dtype.itemsize, payloads.tobytes()
    id_0, id_1, id_2 = layout.message_id & 0xFF, layout.message_id >> 8 & 0xFF, layout.message_id >> 16
    pack, extra, crc = _HEADER.pack, layout.crc_extra, _CRC.pack
    encoded = []
    start = 0
    for system, sequence in zip(systems, sequences, strict=True):
        payload = blob[start : start + size].rstrip(b"\0") or b"\0"
        start += size
        body = pack(len(payload), 0, 0, sequence, system, component, id_0, id_1, id_2) + payload
        encoded.append(MAGIC + body + crc(mcrf4xx(body + extra)))
    return encoded


class Encoder:
    """Encoder of a fleet's frames, with one sequence counter per vehicle.

    Parameters
    ----------
    systems: system id of each vehicle.
    component: component id of all vehicles.
    """

    def __init__(self, systems: Sequence[int], component: int) -> None:
        self._systems = np.array(systems)
        self._component = component
        self._sequences = np.zeros(len(systems), dtype=np.uint8)
        self._codec = mavlink.MAVLink(None, srcComponent=component)

    def pack(self, vehicle: int, message: Any) -> bytes:
        """Pack one message of one vehicle."""
        self._codec.srcSystem = int(self._systems[vehicle])
        self._codec.seq = int(self._sequences[vehicle])
        self._sequences[vehicle] = (self._codec.seq + 1) % 256
        return bytes(message.pack(self._codec))

    def frames(self, layout: Layout, payloads: Payloads, vehicles: npt.NDArray[np.int64]) -> list[bytes]:
        """Pack one message of each vehicle in `vehicles`."""
        sequences = self._sequences[vehicles].tolist()
        self._sequences[vehicles] += 1
        return frames(layout, payloads, self._systems[vehicles].tolist(), sequences, self._component)
