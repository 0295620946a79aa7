"""Flight modes as data: the vehicle's behaviour, and the attributes reported to ground stations."""

from dataclasses import dataclass
from enum import Enum, auto


class Behaviour(Enum):
    """Behaviour of a vehicle in a mode."""

    MISSION = auto()
    GUIDED = auto()  # flies to commanded positions, else holds; obeys set-points
    HOLD = auto()  # stops and holds (a plane circles)
    TAKEOFF = auto()  # climbs to the take-off altitude, then enters FlightParameters.after_takeoff
    RETURN = auto()
    LAND = auto()
    # The sticks fly (`piloting`). At its lowest position the throttle of a copter sinks.
    MANUAL = auto()  # the sticks set lean and thrust; of a plane bank, pitch and throttle
    ALTITUDE = auto()  # lean and climb rate
    POSITION = auto()  # velocity and climb rate
    CRUISE = auto()  # a plane: bank, climb rate and airspeed


PILOTED = frozenset({Behaviour.MANUAL, Behaviour.ALTITUDE, Behaviour.POSITION, Behaviour.CRUISE})


@dataclass(frozen=True, slots=True)
class Mode:
    """One flight mode: its wire number (custom_mode) and its rules."""

    number: int
    name: str
    behaviour: Behaviour
    armable: bool = False  # a ground station can arm the vehicle in this mode
    needs_position: bool = True
    base_mode: int = 0  # MAV_MODE_FLAG bits in addition to CUSTOM_MODE_ENABLED and SAFETY_ARMED
    setpoints_only: bool = False  # requires a stream of set-points (OFFBOARD)
    selectable: bool = True  # a ground station can select this mode
    standard: int = 0  # MAV_STANDARD_MODE
    needs_pilot: bool = False  # needs manual control while armed (see `interface.RemoteInput.missing`)
    terminates: bool = False  # ends the flight; only a reboot leaves the mode
