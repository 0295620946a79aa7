"""The content of an entry about a MAVLink message to a vehicle. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.mavlink.protocol.parameters import decoded

UNRECORDED = frozenset(
    {"HEARTBEAT", "PING", "SYSTEM_TIME", "TIMESYNC", "MISSION_REQUEST_INT", "MISSION_REQUEST"}
)
"""messages that keep a link alive, compare clocks, or ask for the next item of a transfer"""
_OMITTED_FIELDS = frozenset({"target_system", "target_component", "mavpackettype", "secret_key"})
"""addresses; and the key of SETUP_SIGNING, a secret"""
_ENUMS = {"command": "MAV_CMD", "mission_type": "MAV_MISSION_TYPE"}
"""fields whose values are recorded by name"""
COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})
CHANGED_PART = {
    "COMPONENT_ARM_DISARM": "armed",
    "DO_SET_MODE": "mode",
    "SET_MODE": "mode",
    "MISSION_START": "mode",
    "NAV_RETURN_TO_LAUNCH": "mode",
    "NAV_LAND": "mode",
    "DO_SET_MISSION_CURRENT": "mission_seq",
    "MISSION_SET_CURRENT": "mission_seq",
}
"""command -> the part of a vehicle's state that changes when the vehicle follows the command"""


def arms(what: Mapping[str, Any]) -> bool:
    """Return whether a recorded message asks a vehicle to arm; PX4 also arms to start a mission."""
    command = command_of(what)
    return command == "MISSION_START" or (command == "COMPONENT_ARM_DISARM" and what["param1"] != 0.0)


def content(message: Message, *, byte_wise: bool) -> dict[str, Any]:
    """Return `what` of a message's entry. `byte_wise`: as for `parameters.decoded`."""
    what: dict[str, Any] = {"message": message.get_type()}
    for field, value in message.to_dict().items():
        if field in _ENUMS:
            what[field] = name_of(_ENUMS[field], int(value))
        elif field not in _OMITTED_FIELDS:
            what[field] = value.rstrip("\0") if isinstance(value, str) else value
    if what["message"] == "PARAM_SET":
        what["param_value"] = decoded(message, byte_wise=byte_wise).value
    return what


def command_of(what: Mapping[str, Any]) -> str:
    """Return the name of a recorded command, or of the message if it is no command."""
    message = str(what.get("message"))
    return str(what.get("command")) if message in COMMANDS else message
