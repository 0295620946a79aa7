"""Flight modes as data: the behaviour of a vehicle in each, and the attributes a ground station sees."""

from dataclasses import dataclass
from enum import Enum, auto


class Behaviour(Enum):
    """What a vehicle does in a mode when nobody holds a stick."""

    MISSION = auto()
    GUIDED = auto()  # goes where it is told, else holds; obeys set-points
    HOLD = auto()  # stops and holds (a plane circles)
    TAKEOFF = auto()  # climbs to the take-off altitude, then what the personality says comes after
    RETURN = auto()
    LAND = auto()
    SINK = auto()  # the throttle stick reads its minimum: down at the pilot's descent rate
    CRUISE = auto()  # a plane: straight on at the present altitude
    DROP = auto()  # the same without altitude control (a plane glides)


@dataclass(frozen=True, slots=True)
class Mode:
    """One flight mode: its wire number (custom_mode) and what matters about it from outside."""

    number: int
    name: str
    behaviour: Behaviour
    armable: bool = False  # by a ground station
    needs_position: bool = True
    base_mode: int = 0  # MAV_MODE_FLAG bits beside CUSTOM_MODE_ENABLED and SAFETY_ARMED
    setpoints_only: bool = False  # may be entered, and stays, only while set-points stream in (OFFBOARD)
    selectable: bool = True  # by a ground station
    standard: int = 0  # MAV_STANDARD_MODE
    needs_pilot: bool = False  # cannot run armed without manual control (see Tuning.pilot_missing)
    terminates: bool = False  # the flight is over; only a reboot leaves it
