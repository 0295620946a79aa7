"""Messages of a ground station, and names of MAVLink numbers."""

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
