"""Events of a vehicle's session, a closed list, and the vehicle's identity."""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.core.vehicle import VehicleState

SIMULATOR_MARK = b"sim_vehicle\0"
"""first bytes of `AUTOPILOT_VERSION.uid2` of a vehicle of the built-in simulator"""


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a vehicle, from its heartbeat and AUTOPILOT_VERSION."""

    sysid: int
    autopilot: int
    """MAV_AUTOPILOT"""
    vehicle_type: int
    """MAV_TYPE"""
    firmware: str
    """name and version, e.g. "ArduPilot 4.6.2" """
    uid2: bytes
    """18 bytes"""

    @property
    def simulated(self) -> bool:
        """Return whether this is the built-in simulator; an autopilot's own SITL counts as an aircraft."""
        return self.uid2.startswith(SIMULATOR_MARK)


@dataclass(frozen=True, slots=True)
class FirstHeartbeat:
    """The first heartbeat of the vehicle's autopilot."""

    autopilot: int
    vehicle_type: int


@dataclass(frozen=True, slots=True)
class StateChanged:
    """A position came, mode or arming changed, or about a second passed without a position."""

    state: VehicleState


@dataclass(frozen=True, slots=True)
class VehicleLost:
    """No heartbeat for longer than the limit."""

    age_s: float


@dataclass(frozen=True, slots=True)
class VehicleRestored:
    """The first heartbeat after a loss."""

    silent_s: float


@dataclass(frozen=True, slots=True)
class VehicleRebooted:
    """The vehicle's clock began anew: settings made over the link may be gone."""


@dataclass(frozen=True, slots=True)
class StatusText:
    """A STATUSTEXT."""

    severity: int
    """MAV_SEVERITY: 0 emergency ... 7 debug"""
    text: str


@dataclass(frozen=True, slots=True)
class ProcedureDone:
    """A procedure (launch, swap ...) ended; `failure` is None if it succeeded."""

    name: str
    failure: str | None
    stood_still_s: float | None = None
    """of a swap: time in hold or without motion in the air, by the vehicle's clock"""


SessionEvent = (
    FirstHeartbeat
    | StateChanged
    | VehicleLost
    | VehicleRestored
    | VehicleRebooted
    | StatusText
    | ProcedureDone
)
