"""What differs between autopilots: one module each, fitting `Dialect`. Pure."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.command import name_of
from swarmctl.mavlink.dialects.ardupilot import ArduCopter
from swarmctl.mavlink.dialects.base import Dialect, Readiness, Unsupported

__all__ = ["Dialect", "Readiness", "Unsupported", "dialect_for"]

_DIALECTS: dict[tuple[int, int], Dialect] = {
    (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, vehicle_type): ArduCopter()
    for vehicle_type in (
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_COAXIAL,
        mavlink.MAV_TYPE_DODECAROTOR,
        mavlink.MAV_TYPE_DECAROTOR,
    )
}


def dialect_for(autopilot: int, vehicle_type: int) -> Dialect:
    """The dialect for a MAV_AUTOPILOT and MAV_TYPE. Raises Unsupported, naming what it is."""
    dialect = _DIALECTS.get((autopilot, vehicle_type))
    if dialect is not None:
        return dialect
    kind = name_of("MAV_TYPE", vehicle_type)
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        raise Unsupported(f"PX4 vehicles cannot be flown yet (this one is a {kind})")
    name = name_of("MAV_AUTOPILOT", autopilot)
    raise Unsupported(f"{name} vehicles of type {kind} cannot be flown; expected an ArduPilot multicopter")
