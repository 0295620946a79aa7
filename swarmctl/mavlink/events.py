"""What a vehicle's session tells the outside: a closed list, and who the vehicle is."""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.core.vehicle import VehicleState

SIMULATOR_MARK = b"sim_vehicle\0"
"""How `AUTOPILOT_VERSION.uid2` begins where no aircraft is behind the vehicle, only our simulator."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answers: the first heartbeat and AUTOPILOT_VERSION together."""

    sysid: int
    autopilot: int
    """MAV_AUTOPILOT"""
    vehicle_type: int
    """MAV_TYPE"""
    firmware: str
    """name and version for people, e.g. "ArduPilot 4.6.2" """
    uid2: bytes
    """18 bytes"""

    @property
    def simulated(self) -> bool:
        """True only for the built-in simulator; an autopilot's own SITL counts as an aircraft."""
        return self.uid2.startswith(SIMULATOR_MARK)


@dataclass(frozen=True, slots=True)
class FirstHeartbeat:
    """The first heartbeat of the vehicle's autopilot."""

    autopilot: int
    vehicle_type: int


@dataclass(frozen=True, slots=True)
class StateChanged:
    """It has told its position, mode or arming changed, or about a second went by without a position."""

    state: VehicleState


@dataclass(frozen=True, slots=True)
class VehicleLost:
    """No heartbeat for longer than the limit."""

    age_s: float


@dataclass(frozen=True, slots=True)
class VehicleRestored:
    """It is heard again after it was lost."""

    silent_s: float


@dataclass(frozen=True, slots=True)
class VehicleRebooted:
    """Its clock went back: whatever was set on it may be gone."""


@dataclass(frozen=True, slots=True)
class StatusText:
    """A STATUSTEXT."""

    severity: int
    """MAV_SEVERITY: 0 emergency ... 7 debug"""
    text: str


@dataclass(frozen=True, slots=True)
class ProcedureDone:
    """A procedure (launch, swap ...) ended; `failure` is None when it did what it is named after."""

    name: str
    failure: str | None
    stood_still_s: float | None = None
    """of a swap: for how long the vehicle held or stood still in the air for it, by its own clock"""


SessionEvent = (
    FirstHeartbeat
    | StateChanged
    | VehicleLost
    | VehicleRestored
    | VehicleRebooted
    | StatusText
    | ProcedureDone
)
