"""MAVLink 2 frames for a whole fleet at once: columns of numbers in, one frame per vehicle out.

The payloads of all vehicles are one structured array. A stream costs a few array operations and about 1 us
per frame; pymavlink's objects, packing and Python CRC cost far more.
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import MAVLINK2, Layout

MAGIC = bytes([MAVLINK2])
# length, incompatibility flags, compatibility flags, sequence, system, component, 3 bytes of the message id
_HEADER = struct.Struct("<BBBBBBBBB")
_CRC = struct.Struct("<H")
# Smallest and largest float that each integer type can hold.
_LIMITS = {
    np.dtype(kind).str: (float(np.iinfo(kind).min), np.nextafter(float(np.iinfo(kind).max) + 1, 0))
    for kind in (np.uint8, np.int8, np.uint16, np.int16, np.uint32, np.int32, np.uint64, np.int64)
}
Payloads = npt.NDArray[Any]


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
