"""Flight modes as data: the vehicle's behaviour, and the attributes reported to ground stations."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto


class Behaviour(Enum):
    """Behaviour of a vehicle in a mode."""

    MISSION = auto()
    GUIDED = auto()  # flies to commanded positions, else holds; obeys set-points
    HOLD = auto()  # stops and holds (a plane circles)
    TAKEOFF = auto()  # climbs to the take-off altitude, then enters TakeoffParameters.then
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


@dataclass(frozen=True, slots=True)
class ModeTable:
    """The flight modes of one autopilot, and its rules of mode changes."""

    by_number: Mapping[int, Mode]
    boot: int  # number of the mode after a boot
    rereads_switch: bool = True  # after a boot, the mode switch undoes mode changes while disarmed
    # disarming restores the last armable mode, except after a termination
    restored_by_disarming: bool = False
    refuses_leap: bool = False  # on the ground a manual mode with a high throttle is refused

    def of(self, behaviour: Behaviour) -> Mode:
        """Return the mode for an automatic change to a behaviour; raise KeyError if no mode fits."""
        mode = self.find(behaviour)
        if mode is None:
            raise KeyError(behaviour)
        return mode

    def find(self, behaviour: Behaviour) -> Mode | None:
        """Return the mode for an automatic change to a behaviour, or None if no mode fits."""
        for mode in self.by_number.values():
            restricted = mode.setpoints_only or mode.needs_pilot or not mode.selectable
            if mode.behaviour is behaviour and not restricted:
                return mode
        return None
