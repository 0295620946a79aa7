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
