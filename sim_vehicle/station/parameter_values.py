"""Values of parameters in PARAM_SET and PARAM_VALUE, in either encoding of integers.

ArduPilot converts integers to floating point. PX4 sends their bytes in the field of the number.
"""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_FORMATS = {
    mavlink.MAV_PARAM_TYPE_UINT8: "B",
    mavlink.MAV_PARAM_TYPE_INT8: "b",
    mavlink.MAV_PARAM_TYPE_UINT16: "H",
    mavlink.MAV_PARAM_TYPE_INT16: "h",
    mavlink.MAV_PARAM_TYPE_UINT32: "I",
    mavlink.MAV_PARAM_TYPE_INT32: "i",
}
INTEGER_RANGES = {
    mavlink.MAV_PARAM_TYPE_UINT8: (0, 255),
    mavlink.MAV_PARAM_TYPE_INT8: (-128, 127),
    mavlink.MAV_PARAM_TYPE_UINT16: (0, 65_535),
    mavlink.MAV_PARAM_TYPE_INT16: (-32_768, 32_767),
    mavlink.MAV_PARAM_TYPE_UINT32: (0, 2**32 - 1),
    mavlink.MAV_PARAM_TYPE_INT32: (-(2**31), 2**31 - 1),
}


def to_wire(value: float, kind: int, *, byte_wise: bool) -> float:
    """Return the field of a value of type `kind` (MAV_PARAM_TYPE); `byte_wise`: integers as their bytes."""
    if not byte_wise or kind not in _FORMATS:
        return value
    packed = struct.pack(f"<{_FORMATS[kind]}", int(value)).ljust(4, b"\0")
    return float(struct.unpack("<f", packed)[0])


def from_wire(field: float, kind: int, *, byte_wise: bool) -> float:
    """Return the value of a field: the inverse of `to_wire`."""
    if not byte_wise or kind not in _FORMATS:
        return field
    size = struct.calcsize(_FORMATS[kind])
    value: float = struct.unpack(f"<{_FORMATS[kind]}", struct.pack("<f", field)[:size])[0]
    return value
