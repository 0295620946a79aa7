"""Layouts of MAVLink frames and messages, with the messages and fields that pymavlink's dialect lacks.

pymavlink packs and decodes the messages of its dialect. `DefinedMessage` and `decoded` do the same for the
definitions of this module, which come from MAVLink's common.xml.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

MAVLINK1, MAVLINK2 = 0xFE, 0xFD  # first byte of a frame
HEADER_BYTES = {MAVLINK1: 6, MAVLINK2: 10}  # by the first byte, which is included
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
_UNKNOWN = "UNKNOWN_"  # begins pymavlink's name of a message that its dialect lacks


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of one message; `dtype` has the fields of the payload in wire order, without padding."""

    message_id: int
    name: str
    crc_extra: bytes
    dtype: np.dtype[Any]


def _defined(message_id: int, name: str, crc_extra: int, **fields: str) -> Layout:
    return Layout(message_id, name, bytes([crc_extra]), np.dtype(list(fields.items())))


COMMAND_CANCEL = _defined(
    80, "COMMAND_CANCEL", 14, command="<u2", target_system="u1", target_component="u1"
)  # fmt: skip
PROTOCOL_VERSION = _defined(
    300, "PROTOCOL_VERSION", 217, version="<u2", min_version="<u2", max_version="<u2",
    spec_version_hash="8u1", library_version_hash="8u1",
)  # fmt: skip
TIME_ESTIMATE_TO_TARGET = _defined(
    380, "TIME_ESTIMATE_TO_TARGET", 232, safe_return="<i4", land="<i4", mission_next_item="<i4",
    mission_end="<i4", commanded_action="<i4",
)  # fmt: skip
COMPONENT_INFORMATION = _defined(
    395, "COMPONENT_INFORMATION", 0, time_boot_ms="<u4", general_metadata_file_crc="<u4",
    peripherals_metadata_file_crc="<u4", general_metadata_uri="S100", peripherals_metadata_uri="S100",
)  # fmt: skip
COMPONENT_INFORMATION_BASIC = _defined(
    396, "COMPONENT_INFORMATION_BASIC", 50, capabilities="<u8", time_boot_ms="<u4", time_manufacture_s="<u4",
    vendor_name="S32", model_name="S32", software_version="S24", hardware_version="S24", serial_number="S32",
)  # fmt: skip
COMPONENT_METADATA = _defined(397, "COMPONENT_METADATA", 182, time_boot_ms="<u4", file_crc="<u4", uri="S100")
CURRENT_EVENT_SEQUENCE = _defined(411, "CURRENT_EVENT_SEQUENCE", 106, sequence="<u2", flags="u1")
AVAILABLE_MODES = _defined(
    435, "AVAILABLE_MODES", 134, custom_mode="<u4", properties="<u4", number_modes="u1", mode_index="u1",
    standard_mode="u1", mode_name="S35",
)  # fmt: skip
CURRENT_MODE = _defined(
    436, "CURRENT_MODE", 193, custom_mode="<u4", intended_custom_mode="<u4", standard_mode="u1"
)  # fmt: skip
_DEFINED = {
    layout.message_id: layout
    for layout in (
        COMMAND_CANCEL, PROTOCOL_VERSION, TIME_ESTIMATE_TO_TARGET, COMPONENT_INFORMATION,
        COMPONENT_INFORMATION_BASIC, COMPONENT_METADATA, CURRENT_EVENT_SEQUENCE, AVAILABLE_MODES,
        CURRENT_MODE,
    )
}  # fmt: skip
# Extension fields (uint32_t) of messages of the dialect; CRC_EXTRA does not cover extension fields.
_EXTENSIONS = {
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: ("mission_id", "fence_id", "rally_points_id"),
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: ("opaque_id",),
    mavlink.MAVLINK_MSG_ID_MISSION_ACK: ("opaque_id",),
}
CRC_EXTRA: dict[int, int] = {number: kind.crc_extra for number, kind in mavlink.mavlink_map.items()} | {
    number: layout.crc_extra[0] for number, layout in _DEFINED.items()
}
_IDS: dict[str, int] = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()} | {
    layout.name: number for number, layout in _DEFINED.items()
}


def id_of(name: str) -> int:
    """Return the id of a message; raise KeyError for an unknown name."""
    return _IDS[name]


def layout_of(message_id: int) -> Layout:
    """Return the layout of a message; raise KeyError if the id is unknown."""
    if message_id in _DEFINED:
        return _DEFINED[message_id]
    message = mavlink.mavlink_map[message_id]
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    fields: list[Any] = []
    for name, length in zip(message.ordered_fieldnames, message.array_lengths, strict=True):
        if types[name] == "char":
            fields.append((name, f"S{max(length, 1)}"))
        elif length:
            fields.append((name, _NUMPY_TYPES[types[name]], (length,)))
        else:
            fields.append((name, _NUMPY_TYPES[types[name]]))
    fields += [(name, "<u4") for name in _EXTENSIONS.get(message_id, ()) if name not in types]
    return Layout(message_id, message.msgname, bytes([message.crc_extra]), np.dtype(fields))


class DefinedMessage(mavlink.MAVLink_message):  # type: ignore[misc]
    """A message with a layout that pymavlink lacks, used like pymavlink's messages; missing fields are 0."""

    def __init__(self, layout: Layout, **fields: Any) -> None:
        super().__init__(layout.message_id, layout.name)
        self._layout, self._fieldnames = layout, list(fields)
        self.__dict__.update(fields)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = np.zeros(1, self._layout.dtype)
        for name in self._fieldnames:
            payload[name] = getattr(self, name)
        extra = self._layout.crc_extra[0]
        return bytes(self._pack(mav, extra, payload.tobytes(), force_mavlink1=force_mavlink1))


def decoded(message: Any) -> Any:
    """Return a received message; decode a message that the dialect lacks, if its checksum is right."""
    if not message.get_type().startswith(_UNKNOWN):
        return message
    frame = bytes(message.get_msgbuf())
    layout = _DEFINED.get(int(message.get_type().removeprefix(_UNKNOWN)))
    start = HEADER_BYTES[frame[0]]
    end = start + frame[1]
    checksum = int.from_bytes(frame[end : end + 2], "little")
    if layout is None or mcrf4xx(frame[1:end] + layout.crc_extra) != checksum:
        return message
    size = layout.dtype.itemsize
    values = np.frombuffer(frame[start:end][:size].ljust(size, b"\0"), layout.dtype)[0].item()
    found = DefinedMessage(layout, **dict(zip(layout.dtype.fields or (), values, strict=True)))
    seq, system, component = frame[2:5] if frame[0] == MAVLINK1 else frame[4:7]
    found._header = mavlink.MAVLink_header(
        layout.message_id, mlen=frame[1], seq=seq, srcSystem=system, srcComponent=component
    )
    found._msgbuf = bytearray(frame)
    return found
