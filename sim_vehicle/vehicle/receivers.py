"""Handlers of all messages except HEARTBEAT and those of the mission transfer and the storage."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle import commands
from sim_vehicle.vehicle.command import Command
from sim_vehicle.vehicle.interface import Vehicle

COMPONENT = int(mavlink.MAV_COMP_ID_AUTOPILOT1)


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


def _on_set_mode(vehicle: Vehicle, message: Any, now: float) -> None:
    accepted = message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED and vehicle.modes.set(
        message.custom_mode, now
    )
    if vehicle.personality.messages.acknowledges_set_mode:
        result = mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        sender = (message.get_srcSystem(), message.get_srcComponent())
        vehicle.sender.acknowledge(mavlink.MAV_CMD_DO_SET_MODE, result, 0, sender)


def _on_parameter(vehicle: Vehicle, message: Any, now: float) -> None:
    name = vehicle.params.receive(message, vehicle.send, now)
    if name is not None:
        vehicle.parameter_changed(name)


def _on_setup_signing(vehicle: Vehicle, message: Any, _now: float) -> None:
    supports_signing = vehicle.personality.messages.supports_signing
    if supports_signing and not vehicle.signing.set_up(message, armed=vehicle.armed):
        vehicle.announce("signing_refused")


def _on_data_stream(vehicle: Vehicle, message: Any, now: float) -> None:
    rate_hz = message.req_message_rate if message.start_stop else 0
    for stream, message_ids in vehicle.personality.telemetry.streams.items():
        if message.req_stream_id in (mavlink.MAV_DATA_STREAM_ALL, stream):
            for message_id in message_ids:
                vehicle.rates.set(message_id, 1.0 / rate_hz if rate_hz else 0.0, now)


def _on_version_request(vehicle: Vehicle, _message: Any, now: float) -> None:
    if vehicle.personality.messages.answers_version_request:
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, now)


def _on_timesync(vehicle: Vehicle, message: Any, now: float) -> None:
    if message.tc1 == 0:
        ahead_s = vehicle.injected_faults.clock_offset_s(now)
        clock_ns = round((now - vehicle.readiness.boot_s + ahead_s) * 1e9)
        vehicle.send(mavlink.MAVLink_timesync_message(clock_ns, message.ts1))


def _on_ping(vehicle: Vehicle, message: Any, _now: float) -> None:
    is_request = message.target_system == message.target_component == 0
    if is_request and vehicle.personality.messages.answers_ping:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        vehicle.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender))


def _on_set_current(vehicle: Vehicle, message: Any, now: float) -> None:
    if vehicle.set_current(message.seq):
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, now)


def _on_set_origin(vehicle: Vehicle, message: Any, now: float) -> None:
    lat_deg, lon_deg = message.latitude * 1e-7, message.longitude * 1e-7
    origin_moves = vehicle.personality.home.origin_moves
    if origin_moves and message.target_system != vehicle.sysid:
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, now)
        return
    if abs(lat_deg) <= 90 and abs(lon_deg) <= 180 and (vehicle.home_and_rally.origin is None or origin_moves):
        vehicle.home_and_rally.set_origin(GeodeticPosition(lat_deg, lon_deg, message.altitude * 1e-3), now)
    elif origin_moves:
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, now)


def _on_setpoint(vehicle: Vehicle, message: Any, now: float) -> None:
    vehicle.setpoints.receive(message, now)


def _on_sticks(vehicle: Vehicle, message: Any, now: float) -> None:
    vehicle.remote.receive(message, now)


RECEIVERS: dict[str, Callable[[Vehicle, Any, float], None]] = {
    "COMMAND_LONG": _on_command,
    "COMMAND_INT": _on_command,
    "COMMAND_CANCEL": _on_cancel,
    "SET_MODE": _on_set_mode,
    "SETUP_SIGNING": _on_setup_signing,
    "PARAM_REQUEST_LIST": _on_parameter,
    "PARAM_REQUEST_READ": _on_parameter,
    "PARAM_SET": _on_parameter,
    "REQUEST_DATA_STREAM": _on_data_stream,
    "AUTOPILOT_VERSION_REQUEST": _on_version_request,
    "TIMESYNC": _on_timesync,
    "PING": _on_ping,
    "MISSION_SET_CURRENT": _on_set_current,
    "SET_GPS_GLOBAL_ORIGIN": _on_set_origin,
    "SET_POSITION_TARGET_GLOBAL_INT": _on_setpoint,
    "SET_POSITION_TARGET_LOCAL_NED": _on_setpoint,
    "SET_ATTITUDE_TARGET": _on_setpoint,
    "RC_CHANNELS_OVERRIDE": _on_sticks,
    "MANUAL_CONTROL": _on_sticks,
}
