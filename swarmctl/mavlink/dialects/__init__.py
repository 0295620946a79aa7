"""Differences between autopilots, one module for each. No I/O.

A new dialect is a module and a line in `_DIALECTS`. Its `firmware` names a table of parameters in
`swarmctl.preflight.policy`.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.dialects.ardupilot import ArduCopter
from swarmctl.mavlink.dialects.arduplane import ArduPlane
from swarmctl.mavlink.dialects.base import Dialect, Unsupported
from swarmctl.mavlink.dialects.px4 import Px4Copter
from swarmctl.mavlink.dialects.px4plane import Px4Plane
from swarmctl.mavlink.protocol.command import name_of

__all__ = ["ArduCopter", "ArduPlane", "Dialect", "Px4Copter", "Px4Plane", "Unsupported", "dialect_for"]

_MULTICOPTERS = (
    mavlink.MAV_TYPE_QUADROTOR,
    mavlink.MAV_TYPE_HEXAROTOR,
    mavlink.MAV_TYPE_OCTOROTOR,
    mavlink.MAV_TYPE_TRICOPTER,
    mavlink.MAV_TYPE_COAXIAL,
    mavlink.MAV_TYPE_DODECAROTOR,
    mavlink.MAV_TYPE_DECAROTOR,
)
_DIALECTS: dict[tuple[int, int], Dialect] = {
    **{(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, kind): ArduCopter() for kind in _MULTICOPTERS},
    (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_FIXED_WING): ArduPlane(),
    **{(mavlink.MAV_AUTOPILOT_PX4, kind): Px4Copter() for kind in _MULTICOPTERS},
    (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_FIXED_WING): Px4Plane(),
}


def dialect_for(autopilot: int, vehicle_type: int) -> Dialect:
    """Return the dialect for a MAV_AUTOPILOT and MAV_TYPE. Raises Unsupported, naming both."""
    dialect = _DIALECTS.get((autopilot, vehicle_type))
    if dialect is None:
        name = _AUTOPILOTS.get(autopilot) or f"another autopilot ({_in_words('MAV_AUTOPILOT', autopilot)})"
        raise Unsupported(
            f"vehicle type {_in_words('MAV_TYPE', vehicle_type)} of {name} is not supported; expected a "
            "multicopter or a fixed wing of ArduPilot or PX4"
        )
    return dialect


_AUTOPILOTS = {
    int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA): "ArduPilot",
    int(mavlink.MAV_AUTOPILOT_PX4): "PX4",
}


def _in_words(enum: str, value: int) -> str:
    """Return an enum's entry in lower-case words, or as enum and number if pymavlink has no name for it."""
    name = name_of(enum, value)
    if name.startswith(enum):
        return name
    return " ".join(word if word == "VTOL" else word.lower() for word in name.split("_"))
