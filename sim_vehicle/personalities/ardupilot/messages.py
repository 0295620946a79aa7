"""Targets that ArduCopter and ArduPlane report, global and local (`Personality.targets`)."""

from sim_vehicle.personalities.base import Vehicle
from sim_vehicle.vehicle.behaviour import Behaviour

PLANE_MANUAL = 0


def copter_targets(vehicle: Vehicle) -> tuple[bool, bool]:
    """Return (global, local): global in navigating modes, local in GUIDED."""
    flight, behaviour = vehicle.flight, vehicle.mode.behaviour
    if behaviour is Behaviour.GUIDED:
        place_m = None if flight.taking_off else flight.guided_target_m
        return place_m is not None and place_m == vehicle.body.target_m, True
    return not flight.taking_off and behaviour in (Behaviour.MISSION, Behaviour.RETURN), False


def plane_targets(vehicle: Vehicle) -> tuple[bool, bool]:
    """Return (global, local): always global, never local without rotors."""
    return vehicle.mode.number != PLANE_MANUAL, False
