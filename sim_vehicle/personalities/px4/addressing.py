"""Addressing rules of PX4: its receivers check the target of a message individually and differently."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

COMPONENTS = frozenset({int(mavlink.MAV_COMP_ID_ALL), int(mavlink.MAV_COMP_ID_AUTOPILOT1)})
# Accepted also for all systems and any component, as an introduction.
_TO_ANYBODY = frozenset(
    {mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION}
)
_COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})
_TO_SYSTEM = frozenset({"COMMAND_CANCEL", "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"})
_TO_ALL_SYSTEMS = frozenset(
    {
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
        "SET_ATTITUDE_TARGET",
        "FILE_TRANSFER_PROTOCOL",
    }
)


def is_addressed(sysid: int, message: Any) -> bool:
    """Return True if a vehicle processes a message to its system or to all.

    The mission protocol checks its messages itself, as it answers strangers. Other messages are open to all.
    """
    kind = message.get_type()
    if kind in _COMMANDS and message.command in _TO_ANYBODY:
        return True
    if kind in _TO_ALL_SYSTEMS:
        return message.target_component in COMPONENTS
    if kind in _COMMANDS or kind in _TO_SYSTEM:
        return message.target_system == sysid and message.target_component in COMPONENTS
    return True
