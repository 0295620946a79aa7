"""Handlers of messages that ArduPilot treats in its own way, and all handlers of the firmware."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.receivers import COMMON_RECEIVERS, Receiver, origin_of


def _on_set_mode(vehicle: Vehicle, message: Any, now: float) -> None:
    """Change the mode without an acknowledgement."""
    if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        vehicle.modes.set(message.custom_mode, now)


def _on_setup_signing(vehicle: Vehicle, message: Any, _now: float) -> None:
    if not vehicle.signing.set_up(message, armed=vehicle.armed):
        vehicle.announce("signing_refused")


def _on_set_origin(vehicle: Vehicle, message: Any, now: float) -> None:
    """Set a missing origin; an origin does not move."""
    origin = origin_of(message)
    if origin is not None and vehicle.home_and_rally.origin is None:
        vehicle.home_and_rally.set_origin(origin, now)


def _on_version_request(vehicle: Vehicle, _message: Any, now: float) -> None:
    vehicle.send_now(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, now)


RECEIVERS: dict[str, Receiver] = COMMON_RECEIVERS | {
    "SET_MODE": _on_set_mode,
    "SETUP_SIGNING": _on_setup_signing,
    "SET_GPS_GLOBAL_ORIGIN": _on_set_origin,
    "AUTOPILOT_VERSION_REQUEST": _on_version_request,
}
