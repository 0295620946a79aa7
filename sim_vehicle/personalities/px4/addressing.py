"""Addressing rules of PX4: each of its receivers checks the target of a message by a rule of its own."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

COMPONENTS = frozenset({int(mavlink.MAV_COMP_ID_ALL), int(mavlink.MAV_COMP_ID_AUTOPILOT1)})
# Accepted for any system and any component: programs send them before they know the vehicle's ids.
_TO_ANY_TARGET = frozenset(
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
    """Return whether a vehicle processes a message, by the message's target.

    Messages of other types are always processed. Among them are those of the mission protocol, which checks
    the target itself, because it also answers messages to other systems.
    """
    kind = message.get_type()
    if kind in _COMMANDS and message.command in _TO_ANY_TARGET:
        return True
    if kind in _TO_ALL_SYSTEMS:
        return message.target_component in COMPONENTS
    if kind in _COMMANDS or kind in _TO_SYSTEM:
        return message.target_system == sysid and message.target_component in COMPONENTS
    return True
