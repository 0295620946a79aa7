"""Handlers of messages that PX4 treats in its own way, and all handlers of the firmware."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.px4.manoeuvres import on_follow_target
from sim_vehicle.vehicle.command import sender_of
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.receivers import COMMON_RECEIVERS, Receiver, on_mission, origin_of


def _on_set_mode(vehicle: Vehicle, message: Any, now: float) -> None:
    """Change the mode, and answer as to MAV_CMD_DO_SET_MODE."""
    has_mode = message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    accepted = has_mode and vehicle.modes.set(message.custom_mode, now)
    result = mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    vehicle.sender.acknowledge(mavlink.MAV_CMD_DO_SET_MODE, result, 0, sender_of(message))


def _on_set_origin(vehicle: Vehicle, message: Any, now: float) -> None:
    """Move the origin and report it; report the present origin if the message cannot move it."""
    origin = origin_of(message) if message.target_system == vehicle.sysid else None
    if origin is not None:
        vehicle.home_and_rally.set_origin(origin, now)
    else:
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, now)


def _on_ping(vehicle: Vehicle, message: Any, _now: float) -> None:
    """Answer a PING without a target."""
    if message.target_system == message.target_component == 0:
        vehicle.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender_of(message)))


RECEIVERS: dict[str, Receiver] = COMMON_RECEIVERS | {
    "FOLLOW_TARGET": on_follow_target,
    "MISSION_ACK": on_mission,
    "MISSION_SET_CURRENT": on_mission,  # refused during a transfer
    "SET_MODE": _on_set_mode,
    "SET_GPS_GLOBAL_ORIGIN": _on_set_origin,
    "PING": _on_ping,
}
