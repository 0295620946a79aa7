"""What is never sent to a vehicle without permission, whatever a check believes it may do."""

from collections.abc import Set
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.registry import ALTER, ARM, REBOOT, SIMULATOR

_COMMANDS = {
    mavlink.MAV_CMD_NAV_TAKEOFF: ARM,
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: ARM,
    mavlink.MAV_CMD_MISSION_START: ARM,  # PX4 arms for it
    mavlink.MAV_CMD_DO_MOTOR_TEST: ARM,
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: ALTER,
    mavlink.MAV_CMD_PREFLIGHT_STORAGE: ALTER,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: SIMULATOR,
}
_MESSAGES = {
    "RC_CHANNELS_OVERRIDE": ARM,
    "MANUAL_CONTROL": ARM,
    "LOG_ERASE": ALTER,
    "SETUP_SIGNING": ALTER,
}


def permission_for(message: Any) -> str | None:
    """The permission (`registry.PERMISSIONS`) that sending `message` takes; None where it takes none."""
    kind = message.get_type()
    if kind not in ("COMMAND_LONG", "COMMAND_INT"):
        return _MESSAGES.get(kind)
    if message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        return None if message.param1 == 0 else ARM
    if message.command == mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
        return None if message.param1 == 0 and message.param2 == 0 else REBOOT
    return _COMMANDS.get(message.command)


def allowed(message: Any, permits: Set[str]) -> bool:
    wanted = permission_for(message)
    return wanted is None or wanted in permits
