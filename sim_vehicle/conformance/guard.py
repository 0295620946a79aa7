"""What is never sent, whatever a check believes it may do.

Only what leaves a vehicle as it was may reach another system than the one that was met. To that one nothing
is done without its permission, and no plan is overwritten of which there is no copy.
"""

from collections.abc import Set
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.outgoing import Sent

ARM = "arm"  # the motors may turn, or the vehicle flies
REBOOT = "reboot"
ALTER = "alter"  # something of the vehicle is lost or changed for good: logs, calibration, signing key
SIMULATOR = "simulator"  # nobody would do that to a real vehicle
PERMISSIONS = frozenset({ARM, REBOOT, ALTER, SIMULATOR})


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
# What asks or greets and changes nothing: these alone may go to another system, or to everybody.
_ASKING = frozenset(
    {"HEARTBEAT", "TIMESYNC", "PING", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "MISSION_REQUEST_LIST"}
)
_ASKING_COMMANDS = frozenset(
    {mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES}
)
_PLANS = frozenset(
    {"MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST", "MISSION_ITEM", "MISSION_ITEM_INT"}
)
_OLD_PLANS = {
    "FENCE_POINT": int(mavlink.MAV_MISSION_TYPE_FENCE),
    "RALLY_POINT": int(mavlink.MAV_MISSION_TYPE_RALLY),
}
PLAN_NAMES = {
    int(mavlink.MAV_MISSION_TYPE_MISSION): "mission",
    int(mavlink.MAV_MISSION_TYPE_FENCE): "fence",
    int(mavlink.MAV_MISSION_TYPE_RALLY): "rally points",
}


class Forbidden(Exception):
    """A check wanted to send what could change another vehicle than the one that was met."""


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


def only_asks(sent: Sent) -> bool:
    """Whether a frame leaves everybody who takes it as they were."""
    if sent.kind in ("COMMAND_LONG", "COMMAND_INT"):
        return sent.message.command in _ASKING_COMMANDS
    return sent.kind in _ASKING


def is_for(sent: Sent, vehicle: int) -> bool:
    """Whether a frame is for this system alone; before a vehicle is met (0) there is none it could be for."""
    return vehicle != 0 and sent.target == vehicle


def refusal(sent: Sent, permits: Set[str], saved: Set[int]) -> str | None:
    """Why a frame may not be sent to the vehicle that was met; None where it may.

    `saved`: the MAV_MISSION_TYPE of the plans there is a copy of.
    """
    wanted = None if sent.message is None else permission_for(sent.message)
    if wanted is not None and wanted not in permits:
        return f"{sent.kind} takes --allow-{wanted}"
    plan = sent.message.mission_type if sent.kind in _PLANS else _OLD_PLANS.get(sent.kind)
    if plan is not None and plan not in saved:
        return f"its {PLAN_NAMES.get(plan, f'plans of type {plan}')} could not be saved"
    return None
