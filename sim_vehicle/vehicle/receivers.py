"""Handlers of the messages that all autopilots treat alike.

A personality's table (`MessageRules.receivers`) has these handlers and its own. HEARTBEAT is in no table.
"""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle import commands
from sim_vehicle.vehicle.command import Command
from sim_vehicle.vehicle.interface import Vehicle

COMPONENT = int(mavlink.MAV_COMP_ID_AUTOPILOT1)
Receiver = Callable[[Vehicle, Any, float], None]  # vehicle, message, time [s]


def _on_command(vehicle: Vehicle, message: Any, now: float) -> None:
    command = Command.from_message(message)
    result = commands.execute(vehicle, command, now)
    if result != commands.NO_ANSWER:
        vehicle.sender.acknowledge(command.command, result, 0, command.sender)
    if vehicle.reboot_after_reply:
        vehicle.reboot_after_reply = False
        vehicle.reboot(now)


def _on_cancel(vehicle: Vehicle, message: Any, _now: float) -> None:
    vehicle.jobs.cancel(message)


def _on_parameter(vehicle: Vehicle, message: Any, now: float) -> None:
    name = vehicle.params.receive(message, vehicle.send, now)
    if name is not None:
        vehicle.parameter_changed(name)


def _on_data_stream(vehicle: Vehicle, message: Any, now: float) -> None:
    rate_hz = message.req_message_rate if message.start_stop else 0
    for stream, message_ids in vehicle.personality.telemetry.streams.items():
        if message.req_stream_id in (mavlink.MAV_DATA_STREAM_ALL, stream):
            for message_id in message_ids:
                vehicle.rates.set(message_id, 1.0 / rate_hz if rate_hz else 0.0, now)


def _on_timesync(vehicle: Vehicle, message: Any, now: float) -> None:
    if message.tc1 == 0:
        ahead_s = vehicle.injected_faults.clock_offset_s(now)
        clock_ns = round((now - vehicle.readiness.boot_s + ahead_s) * 1e9)
        vehicle.send(mavlink.MAVLink_timesync_message(clock_ns, message.ts1))


def _on_set_current(vehicle: Vehicle, message: Any, now: float) -> None:
    if vehicle.mission.set_current(message.seq):
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, now)


def origin_of(message: Any) -> GeodeticPosition | None:
    """Return the position in SET_GPS_GLOBAL_ORIGIN; None if a coordinate is out of range."""
    lat_deg, lon_deg = message.latitude * 1e-7, message.longitude * 1e-7
    in_range = abs(lat_deg) <= 90 and abs(lon_deg) <= 180
    return GeodeticPosition(lat_deg, lon_deg, message.altitude * 1e-3) if in_range else None


def _on_setpoint(vehicle: Vehicle, message: Any, now: float) -> None:
    vehicle.setpoints.receive(message, now)


def on_mission(vehicle: Vehicle, message: Any, now: float) -> None:
    """Pass a message of the mission protocol to the vehicle's transfer."""
    vehicle.transfer.receive(message, now)


def _on_storage(vehicle: Vehicle, message: Any, now: float) -> None:
    vehicle.storage.receive(message, now)


def _on_sticks(vehicle: Vehicle, message: Any, now: float) -> None:
    vehicle.remote.receive(message, now)


COMMON_RECEIVERS: dict[str, Receiver] = {
    "COMMAND_LONG": _on_command,
    "COMMAND_INT": _on_command,
    "COMMAND_CANCEL": _on_cancel,
    "PARAM_REQUEST_LIST": _on_parameter,
    "PARAM_REQUEST_READ": _on_parameter,
    "PARAM_SET": _on_parameter,
    "REQUEST_DATA_STREAM": _on_data_stream,
    "TIMESYNC": _on_timesync,
    "MISSION_COUNT": on_mission,
    "MISSION_ITEM_INT": on_mission,
    "MISSION_ITEM": on_mission,
    "MISSION_WRITE_PARTIAL_LIST": on_mission,
    "MISSION_REQUEST_LIST": on_mission,
    "MISSION_REQUEST_INT": on_mission,
    "MISSION_REQUEST": on_mission,
    "MISSION_CLEAR_ALL": on_mission,
    "MISSION_SET_CURRENT": _on_set_current,
    "FILE_TRANSFER_PROTOCOL": _on_storage,
    "LOG_REQUEST_LIST": _on_storage,
    "LOG_REQUEST_DATA": _on_storage,
    "LOG_REQUEST_END": _on_storage,
    "LOG_ERASE": _on_storage,
    "SET_POSITION_TARGET_GLOBAL_INT": _on_setpoint,
    "SET_POSITION_TARGET_LOCAL_NED": _on_setpoint,
    "SET_ATTITUDE_TARGET": _on_setpoint,
    "RC_CHANNELS_OVERRIDE": _on_sticks,
    "MANUAL_CONTROL": _on_sticks,
}
