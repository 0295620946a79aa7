"""Flight modes of PX4 1.15: numbers and behaviour.

custom_mode on the wire is sub mode << 24 | main mode << 16. A disarmed vehicle accepts a pilot's mode
(`needs_pilot`). Without manual control, a vehicle does not arm in a pilot's mode, and an armed vehicle does
not change to such a mode.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.behaviour import Behaviour, Mode

MAIN_MANUAL, MAIN_ALTITUDE, MAIN_POSITION, MAIN_AUTO = 1, 2, 3, 4
MAIN_ACRO, MAIN_OFFBOARD, MAIN_STABILIZED, MAIN_TERMINATION = 5, 6, 7, 10
SUB_ORBIT, SUB_SLOW = 1, 2  # of MAIN_POSITION
SUB_TAKEOFF, SUB_HOLD, SUB_MISSION, SUB_RETURN, SUB_LAND = 2, 3, 4, 5, 6  # of MAIN_AUTO
SUB_FOLLOW, SUB_PRECISION_LAND = 8, 9  # of MAIN_AUTO

_PILOT = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_AUTO = (
    mavlink.MAV_MODE_FLAG_AUTO_ENABLED
    | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
)


def number(main: int, sub: int = 0) -> int:
    """Return custom_mode of a main and a sub mode."""
    return sub << 24 | main << 16


MANUAL = number(MAIN_MANUAL)
ALTITUDE = number(MAIN_ALTITUDE)
POSITION = number(MAIN_POSITION)
ORBIT = number(MAIN_POSITION, SUB_ORBIT)
POSITION_SLOW = number(MAIN_POSITION, SUB_SLOW)
TAKEOFF = number(MAIN_AUTO, SUB_TAKEOFF)
HOLD = number(MAIN_AUTO, SUB_HOLD)
MISSION = number(MAIN_AUTO, SUB_MISSION)
RETURN = number(MAIN_AUTO, SUB_RETURN)
LAND = number(MAIN_AUTO, SUB_LAND)
FOLLOW = number(MAIN_AUTO, SUB_FOLLOW)
PRECISION_LAND = number(MAIN_AUTO, SUB_PRECISION_LAND)
ACRO = number(MAIN_ACRO)
OFFBOARD = number(MAIN_OFFBOARD)
STABILIZED = number(MAIN_STABILIZED)
TERMINATION = number(MAIN_TERMINATION)


def _pilot_mode(
    custom_mode: int,
    name: str,
    behaviour: Behaviour,
    base_mode: int,
    *,
    needs_position: bool = False,
    standard: int = 0,
) -> Mode:
    return Mode(
        custom_mode,
        name,
        behaviour,
        armable=True,
        needs_position=needs_position,
        base_mode=base_mode,
        standard=standard,
        needs_pilot=True,
    )


def _auto_mode(
    custom_mode: int, name: str, behaviour: Behaviour, standard: int = 0, *, armable: bool = False
) -> Mode:
    return Mode(custom_mode, name, behaviour, armable=armable, base_mode=_AUTO, standard=standard)


_MODES = (
    _pilot_mode(MANUAL, "Manual", Behaviour.MANUAL, _PILOT),
    _pilot_mode(
        ALTITUDE, "Altitude", Behaviour.ALTITUDE, _PILOT, standard=mavlink.MAV_STANDARD_MODE_ALTITUDE_HOLD
    ),
    _pilot_mode(
        POSITION,
        "Position",
        Behaviour.POSITION,
        _PILOT,
        needs_position=True,
        standard=mavlink.MAV_STANDARD_MODE_POSITION_HOLD,
    ),
    _pilot_mode(POSITION_SLOW, "Position Slow", Behaviour.POSITION, _PILOT, needs_position=True),
    _auto_mode(MISSION, "Mission", Behaviour.MISSION, mavlink.MAV_STANDARD_MODE_MISSION, armable=True),
    _auto_mode(HOLD, "Hold", Behaviour.HOLD, armable=True),
    _auto_mode(RETURN, "Return", Behaviour.RETURN, mavlink.MAV_STANDARD_MODE_SAFE_RECOVERY),
    _pilot_mode(ACRO, "Acro", Behaviour.MANUAL, mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED),
    Mode(
        OFFBOARD,
        "Offboard",
        Behaviour.GUIDED,
        armable=True,
        base_mode=mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED,
        setpoints_only=True,
    ),
    _pilot_mode(STABILIZED, "Stabilized", Behaviour.MANUAL, _PILOT),
    _auto_mode(TAKEOFF, "Takeoff", Behaviour.TAKEOFF, mavlink.MAV_STANDARD_MODE_TAKEOFF, armable=True),
    Mode(
        LAND,
        "Land",
        Behaviour.LAND,
        needs_position=False,
        base_mode=_AUTO,
        standard=mavlink.MAV_STANDARD_MODE_LAND,
    ),
    _auto_mode(FOLLOW, "Follow Target", Behaviour.HOLD),
    _auto_mode(PRECISION_LAND, "Precision Landing", Behaviour.LAND),
    Mode(
        ORBIT,
        "Orbit",
        Behaviour.HOLD,
        base_mode=_AUTO,
        standard=mavlink.MAV_STANDARD_MODE_ORBIT,
        selectable=False,
    ),
    Mode(
        TERMINATION,
        "Termination",
        Behaviour.MANUAL,
        needs_position=False,
        selectable=False,
        terminates=True,
    ),
)
MODES: dict[int, Mode] = {mode.number: mode for mode in _MODES}
