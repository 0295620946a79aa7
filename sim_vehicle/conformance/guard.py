"""Permissions, and the frames that are never sent.

Other systems may receive only frames without an effect. A frame to the vehicle under test may need a
permission. A plan without a saved copy is not overwritten.
"""

import math
from collections.abc import Set
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ARM = "arm"  # motors turn, or the vehicle flies
REBOOT = "reboot"
ALTER = "alter"  # a lasting change: logs, calibration, stored parameters, signing key
CRASH = "crash"  # frames that ended a known firmware; sent after all other checks and the restoration
SIMULATOR = "simulator"  # only for the simulator
PERMISSIONS = frozenset({ARM, REBOOT, ALTER, CRASH, SIMULATOR})

_COMMAND_PERMISSIONS = {
    mavlink.MAV_CMD_NAV_TAKEOFF: ARM,
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: ARM,
    mavlink.MAV_CMD_MISSION_START: ARM,  # PX4 arms for MISSION_START
    mavlink.MAV_CMD_DO_MOTOR_TEST: ARM,
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: ALTER,
    mavlink.MAV_CMD_PREFLIGHT_STORAGE: ALTER,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: SIMULATOR,
}
# Commands whose parameter 1 is the id of a message; parameter 2 of SET_MESSAGE_INTERVAL is an interval.
# ArduPilot converts both without a check (GCS_Common.cpp, `handle_command_request_message` and
# `handle_command_set_message_interval`), and in its SITL a floating point exception ends the process.
_COMMANDS_WITH_AN_ID = frozenset({mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL})
_ID_LIMIT = 2**24  # MAVLink 2 has message ids of three bytes
_INTERVAL_LIMIT = 2**31  # [us]
_MESSAGE_PERMISSIONS = {
    "RC_CHANNELS_OVERRIDE": ARM,
    "MANUAL_CONTROL": ARM,
    "LOG_ERASE": ALTER,
    "SETUP_SIGNING": ALTER,
}
# Messages without an effect; only these may go to another system or to all systems.
_READ_ONLY = frozenset(
    {"HEARTBEAT", "TIMESYNC", "PING", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "MISSION_REQUEST_LIST"}
)
_READ_ONLY_COMMANDS = frozenset(
    {mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES}
)
_PLAN_MESSAGES = frozenset(
    {"MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST", "MISSION_ITEM", "MISSION_ITEM_INT"}
)
_LEGACY_PLAN_MESSAGES = {
    "FENCE_POINT": int(mavlink.MAV_MISSION_TYPE_FENCE),
    "RALLY_POINT": int(mavlink.MAV_MISSION_TYPE_RALLY),
}
PLAN_NAMES = {
    int(mavlink.MAV_MISSION_TYPE_MISSION): "mission",
    int(mavlink.MAV_MISSION_TYPE_FENCE): "fence",
    int(mavlink.MAV_MISSION_TYPE_RALLY): "rally points",
}


class Forbidden(Exception):
    """A frame that could change another vehicle; it is not sent."""


def permission_for(message: Any) -> str | None:
    """Return the permission that a message needs (`PERMISSIONS`), or None."""
    kind = message.get_type()
    if kind not in ("COMMAND_LONG", "COMMAND_INT"):
        return _MESSAGE_PERMISSIONS.get(kind)
    if message.command in _COMMANDS_WITH_AN_ID and not 0 <= message.param1 < _ID_LIMIT:  # also true for NaN
        return CRASH
    if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and not abs(message.param2) < _INTERVAL_LIMIT:
        return CRASH
    if message.command == mavlink.MAV_CMD_DO_CHANGE_SPEED and not math.isfinite(message.param2):
        return CRASH  # such a speed ended ArduCopter in flight
    if message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        return None if message.param1 == 0 else ARM
    if message.command == mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
        return None if message.param1 == 0 and message.param2 == 0 else REBOOT
    return _COMMAND_PERMISSIONS.get(message.command)


def is_read_only(message: Any) -> bool:
    """Return True if a message changes nothing on any receiver."""
    kind = message.get_type()
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        return message.command in _READ_ONLY_COMMANDS
    return kind in _READ_ONLY


def target_of(message: Any) -> int:
    """Return the system id of the receiver of a message; 0: all receivers."""
    # Only MANUAL_CONTROL uses the second name.
    return int(next((getattr(message, n) for n in ("target_system", "target") if hasattr(message, n)), 0))


def refusal(message: Any, permissions: Set[str], saved_plans: Set[int]) -> str | None:
    """Return the reason against sending a message to the vehicle under test, or None.

    `saved_plans`: MAV_MISSION_TYPE of the plans with a copy.
    """
    kind, needed = message.get_type(), permission_for(message)
    if needed is not None and needed not in permissions:
        return f"{kind} needs {'the built-in simulator' if needed == SIMULATOR else f'--allow-{needed}'}"
    plan_type = message.mission_type if kind in _PLAN_MESSAGES else _LEGACY_PLAN_MESSAGES.get(kind)
    if plan_type is not None and plan_type not in saved_plans:
        name = PLAN_NAMES.get(plan_type, f"plans of type {plan_type}")
        return f"{kind} was not sent, because the {name} could not be saved [plan-unsaved]"
    return None
