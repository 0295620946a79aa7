"""Flight modes of ArduCopter and ArduPlane 4.6: numbers, names, behaviour, reported targets."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.behaviour import Behaviour, Mode
from sim_vehicle.vehicle.interface import Vehicle

PLANE_MANUAL = 0
_STABILIZED = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
_GUIDED = _STABILIZED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
_PLANE_AUTO = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED


def _table(*modes: Mode) -> dict[int, Mode]:
    return {mode.number: mode for mode in modes}


COPTER_MODES = _table(
    Mode(0, "STABILIZE", Behaviour.MANUAL, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(1, "ACRO", Behaviour.MANUAL, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(2, "ALT_HOLD", Behaviour.ALTITUDE, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(3, "AUTO", Behaviour.MISSION, base_mode=_GUIDED),
    Mode(4, "GUIDED", Behaviour.GUIDED, armable=True, base_mode=_GUIDED),
    Mode(5, "LOITER", Behaviour.POSITION, armable=True, base_mode=_GUIDED),
    Mode(6, "RTL", Behaviour.RETURN, base_mode=_GUIDED),
    Mode(7, "CIRCLE", Behaviour.POSITION, base_mode=_GUIDED),
    Mode(9, "LAND", Behaviour.LAND, needs_position=False, base_mode=_STABILIZED),
    Mode(16, "POSHOLD", Behaviour.POSITION, armable=True, base_mode=_GUIDED),
    Mode(17, "BRAKE", Behaviour.HOLD, base_mode=_GUIDED),
)

PLANE_MODES = _table(
    Mode(0, "MANUAL", Behaviour.MANUAL, armable=True, needs_position=False, base_mode=64),
    Mode(1, "CIRCLE", Behaviour.HOLD, armable=True, needs_position=False, base_mode=_PLANE_AUTO),
    Mode(2, "STABILIZE", Behaviour.MANUAL, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(5, "FBWA", Behaviour.MANUAL, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(6, "FBWB", Behaviour.CRUISE, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(7, "CRUISE", Behaviour.CRUISE, armable=True, needs_position=False, base_mode=_STABILIZED),
    Mode(10, "AUTO", Behaviour.MISSION, armable=True, base_mode=_PLANE_AUTO),
    Mode(11, "RTL", Behaviour.RETURN, base_mode=_PLANE_AUTO),
    Mode(12, "LOITER", Behaviour.HOLD, armable=True, base_mode=_PLANE_AUTO),
    Mode(13, "TAKEOFF", Behaviour.TAKEOFF, armable=True, base_mode=_PLANE_AUTO),
    Mode(15, "GUIDED", Behaviour.GUIDED, armable=True, base_mode=_PLANE_AUTO),
)


def copter_targets(vehicle: Vehicle) -> tuple[bool, bool]:
    """Return the reported targets (global, local): global during a flight to a position, local in GUIDED."""
    flight, behaviour = vehicle.flight, vehicle.mode.behaviour
    if behaviour is Behaviour.GUIDED:
        place_m = None if flight.taking_off else flight.guided_target_m
        return place_m is not None and place_m == vehicle.body.target_m, True
    return not flight.taking_off and behaviour in (Behaviour.MISSION, Behaviour.RETURN), False


def plane_targets(vehicle: Vehicle) -> tuple[bool, bool]:
    """Return the reported targets (global, local): global except in MANUAL, never local."""
    return vehicle.mode.number != PLANE_MANUAL, False
