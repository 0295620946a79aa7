"""ArduPilot's packed files: parameters (`@PARAM/param.pck`), mission, fence and rally (`@MISSION/*.dat`)."""

import errno
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files.filesystem import FileError

PARAMETERS_MAGIC = 0x671B
PARAMETERS_WITH_DEFAULTS_MAGIC = 0x671C
PARAMETERS_HEADER = struct.Struct("<HHH")  # magic, parameters in this file, parameters of the vehicle
MISSION_MAGIC = 0x763D
MISSION_HEADER = struct.Struct("<HHHHH")  # magic, MAV_MISSION_TYPE, options, first index, number of items
NO_CLEAR = 1  # option: uploaded items replace or extend the stored items
MAX_NAME_BYTES = 16

_FLOAT = 4
_INTEGERS = {8: 1, 16: 2, 32: 3}  # number of bits -> type of the value
_VALUES = {1: struct.Struct("<b"), 2: struct.Struct("<h"), 3: struct.Struct("<i"), 4: struct.Struct("<f")}
_ITEM = mavlink.MAVLink_mission_item_int_message


class Parameter(NamedTuple):
    """One parameter, an integer if its value is an int."""

    name: str
    value: float | int
    default: float | int
    bits: int = 32  # size of an integer


def pack_parameters(parameters: Sequence[Parameter], query: str = "") -> bytes:
    """Return `param.pck` for a query (`start=`, `count=`, `withdefaults=`); raise FileError if it is invalid.

    A name omits up to 15 characters that it shares with the start of the previous name. The content does not
    change while the file is open, so reads need no padding.
    """
    options = _query(query)
    start, count, defaults = options["start"], options["count"], bool(options["withdefaults"])
    if start >= max(len(parameters), 1):
        raise FileError(errno.EINVAL)
    chosen = parameters[start : start + count] if count else parameters[start:]
    magic = PARAMETERS_WITH_DEFAULTS_MAGIC if defaults else PARAMETERS_MAGIC
    packed = bytearray(PARAMETERS_HEADER.pack(magic, len(chosen), len(parameters)))
    previous = b""
    for name, value, default, bits in chosen:
        kind = _INTEGERS[bits] if isinstance(value, int) else _FLOAT
        differs = defaults and default != value
        encoded = name.encode("ascii")[:MAX_NAME_BYTES]
        common = min(_common_length(previous, encoded), len(encoded) - 1)
        packed += bytes([kind | differs << 4, common | (len(encoded) - common - 1) << 4])
        packed += encoded[common:] + _value(kind, value)
        if differs:
            packed += _value(kind, default)
        previous = encoded
    return bytes(packed)


def unpack_parameters(content: bytes) -> dict[str, float | int] | None:
    """Return the values in an uploaded `param.pck`, or None if malformed."""
    if len(content) < PARAMETERS_HEADER.size:
        return None
    magic, count, length = PARAMETERS_HEADER.unpack_from(content)  # length: size of the upload [bytes]
    if magic != PARAMETERS_MAGIC or length != len(content):
        return None
    values: dict[str, float | int] = {}
    offset, previous = PARAMETERS_HEADER.size, b""
    for _ in range(count):
        if offset + 2 > length:
            return None
        kind, common, more = content[offset], content[offset + 1] & 15, (content[offset + 1] >> 4) + 1
        form = _VALUES.get(kind)
        offset += 2
        if (
            form is None
            or common > len(previous)
            or common + more > MAX_NAME_BYTES
            or offset + more + form.size > length
        ):
            return None
        previous = previous[:common] + content[offset : offset + more]
        try:
            name = previous.decode("ascii")
        except UnicodeDecodeError:
            return None
        values[name] = form.unpack_from(content, offset + more)[0]
        offset += more + form.size
    return values


def pack_mission(mission_type: int, items: Iterable[Any]) -> bytes:
    """Return `mission.dat`, `fence.dat` or `rally.dat` from MISSION_ITEM_INT messages."""
    packed = [
        _ITEM.unpacker.pack(*(getattr(item, field) for field in _ITEM.ordered_fieldnames)) for item in items
    ]
    return MISSION_HEADER.pack(MISSION_MAGIC, mission_type, 0, 0, len(packed)) + b"".join(packed)


class UploadedMission(NamedTuple):
    """An uploaded mission, fence or rally file; `start` is the index of its first item."""

    start: int
    clear: bool  # True: the upload replaces all stored items
    items: list[Any]  # MISSION_ITEM_INT


def unpack_mission(mission_type: int, content: bytes) -> UploadedMission | None:
    """Return the content of an uploaded file, or None if malformed, incomplete or of another type."""
    if len(content) < MISSION_HEADER.size:
        return None
    magic, kind, options, start, count = MISSION_HEADER.unpack_from(content)
    size = _ITEM.unpacker.size
    if (magic, kind) != (MISSION_MAGIC, mission_type) or len(content) != MISSION_HEADER.size + count * size:
        return None
    items = []
    for offset in range(MISSION_HEADER.size, len(content), size):
        if not any(content[offset : offset + size]):  # the client has not written this item
            return None
        fields = _ITEM.unpacker.unpack_from(content, offset)
        items.append(_ITEM(**dict(zip(_ITEM.ordered_fieldnames, fields, strict=True))))
    return UploadedMission(start, not options & NO_CLEAR, items)


def _query(query: str) -> Mapping[str, int]:
    options = {"start": 0, "count": 0, "withdefaults": 0}
    for part in filter(None, query.split("&")):
        key, _, text = part.partition("=")
        if key in options:
            if not text.isascii() or not text.isdigit() or int(text) >= 0xFFFF:
                raise FileError(errno.EINVAL)
            options[key] = int(text)
    if options["withdefaults"] > 1:
        raise FileError(errno.EINVAL)
    return options


def _common_length(name: bytes, next_name: bytes) -> int:
    length = 0
    for a, b in zip(name, next_name, strict=False):
        if a != b:
            break
        length += 1
    return min(length, 15)


def _value(kind: int, value: float) -> bytes:
    return _VALUES[kind].pack(value if kind == _FLOAT else int(value))
