"""Flight modes as data: the vehicle's behaviour, and the attributes reported to ground stations."""

from dataclasses import dataclass
from enum import Enum, auto


class Behaviour(Enum):
    """Behaviour of a vehicle in a mode while no pilot moves the sticks."""

    MISSION = auto()
    GUIDED = auto()  # flies to commanded positions, else holds; obeys set-points
    HOLD = auto()  # stops and holds (a plane circles)
    TAKEOFF = auto()  # climbs to the take-off altitude, then enters FlightParameters.after_takeoff
    RETURN = auto()
    LAND = auto()
    SINK = auto()  # descends at the pilot's rate: the throttle stick reads its minimum
    CRUISE = auto()  # a plane: straight on at the present altitude
    DROP = auto()  # sinks fast, without altitude control: the throttle stick reads its minimum


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
    needs_pilot: bool = False  # needs manual control while armed (see FlightParameters.pilot_missing)
    terminates: bool = False  # ends the flight; only a reboot leaves the mode
