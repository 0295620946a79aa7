"""Contents of a ground station's messages: commands, plan items, parameter values; names and texts."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Target = tuple[int, int]  # (system id, component id)


def heartbeat() -> Any:
    """Return the HEARTBEAT of a ground station."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def command_long(target: Target, command: int, *params: float, confirmation: int = 0) -> Any:
    """Return COMMAND_LONG; further parameters are 0."""
    padded = [*params, *[0.0] * (7 - len(params))]
    return mavlink.MAVLink_command_long_message(*target, command, confirmation, *padded)


def command_int(
    target: Target,
    command: int,
    *params: float,
    frame: int = mavlink.MAV_FRAME_GLOBAL,
    x: int = 0,
    y: int = 0,
    z: float = 0.0,
) -> Any:
    """Return COMMAND_INT; further parameters are 0."""
    padded = [*params, *[0.0] * (4 - len(params))]
    return mavlink.MAVLink_command_int_message(*target, frame, command, 0, 0, *padded, x, y, z)


def set_mode(target: Target, custom_mode: int) -> Any:
    """Return DO_SET_MODE. PX4 needs main mode and sub mode as separate parameters."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    params = (main, sub) if main else (custom_mode,)
    custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    return command_long(target, mavlink.MAV_CMD_DO_SET_MODE, custom, *params)


def enum_name(enum: str, value: int, prefix: str) -> str:
    """Return the name of a MAVLink number, or the number if it has no name."""
    entry = mavlink.enums[enum].get(value)
    return str(value) if entry is None else str(entry.name.removeprefix(prefix))


# -- plans ----------------------------------------------------------------------------------------------

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
RELATIVE = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
FLOAT_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}  # frame of an integer position -> frame of the same position in floating point


@dataclass(frozen=True, slots=True)
class PlanItem:
    """An outgoing item: x, y [1e-7 deg], z [m] in `frame` (MAV_FRAME)."""

    command: int
    x: int = 0
    y: int = 0
    z: float = 0.0
    frame: int = RELATIVE
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def message(self, target: Target, seq: int, kind: int = MISSION, *, as_float: bool = False) -> Any:
        """Return MISSION_ITEM_INT, or the legacy MISSION_ITEM; `kind` is the MAV_MISSION_TYPE."""
        # The field `current` is 0, because PX4 would start at an item with 1.
        frame = FLOAT_FRAMES.get(self.frame, self.frame) if as_float else self.frame
        head = (*target, seq, frame, self.command, 0, 1, *self.params)
        if as_float:
            return mavlink.MAVLink_mission_item_message(*head, self.x / 1e7, self.y / 1e7, self.z, kind)
        return mavlink.MAVLink_mission_item_int_message(*head, self.x, self.y, self.z, kind)


# -- parameters -----------------------------------------------------------------------------------------

# ArduPilot converts the integers of PARAM_SET and PARAM_VALUE to floating point. PX4 sends their bytes in the
# field of the number.
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


# -- texts ----------------------------------------------------------------------------------------------

GAP = "[...]"  # text in place of a missing chunk


class StatusTexts:
    """Texts of STATUSTEXT, assembled from their chunks, in the order of the first received chunks."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._open: dict[int, tuple[int, dict[int, str]]] = {}  # id -> index in `texts`, chunks by number

    def receive(self, message: Any) -> None:
        """Process a STATUSTEXT; a text with id 0 has one chunk."""
        if message.id == 0:
            self.texts.append(message.text)
            return
        index, chunks = self._open.get(message.id, (-1, {}))
        if index < 0 or chunks.get(message.chunk_seq, message.text) != message.text:
            # A new text, or a reused id; a repeated chunk has equal text.
            index, chunks = len(self.texts), {}
            self._open[message.id] = index, chunks
            self.texts.append("")
        chunks[message.chunk_seq] = message.text
        self.texts[index] = "".join(chunks.get(i, GAP) for i in range(max(chunks) + 1))


def joined_texts(messages: Iterable[Any]) -> list[str]:
    """Return the texts of STATUSTEXT messages, with their chunks joined."""
    texts = StatusTexts()
    for message in messages:
        texts.receive(message)
    return texts.texts
