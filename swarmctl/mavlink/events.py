"""The events of a vehicle's session (`SessionEvent` has all of them), and the vehicle's identity."""

from __future__ import annotations

from typing import Any

import msgspec

from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.protocol.outcome import Done

SIMULATOR_MARK = b"sim_vehicle\0"
"""first bytes of `AUTOPILOT_VERSION.uid2` in the built-in simulator"""


class Identity(msgspec.Struct, frozen=True):
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
        """Return whether the built-in simulator runs this vehicle. Other simulators count as aircraft."""
        return self.uid2.startswith(SIMULATOR_MARK)


class FirstHeartbeat(msgspec.Struct, frozen=True):
    """The first heartbeat of the vehicle's autopilot."""

    autopilot: int
    vehicle_type: int


class StateChanged(msgspec.Struct, frozen=True):
    """A new state of the vehicle.

    | occasion | delay |
    |---|---|
    | GLOBAL_POSITION_INT | none |
    | a change of mode, arming or `other_mission` | none |
    | the first heartbeat after a loss | none |
    | other telemetry | about 1 s after the last state |
    """

    state: VehicleState


class VehicleLost(msgspec.Struct, frozen=True):
    """No heartbeat for longer than the limit; reported again each second until the next heartbeat."""

    age_s: float


class VehicleRestored(msgspec.Struct, frozen=True):
    """The first heartbeat after a loss."""

    silent_s: float


class VehicleRebooted(msgspec.Struct, frozen=True):
    """A reboot, recognised by the vehicle's clock. Settings made over the link may be lost."""


class StatusText(msgspec.Struct, frozen=True):
    """A STATUSTEXT."""

    severity: int
    """MAV_SEVERITY: 0 emergency ... 7 debug"""
    text: str


class ProcedureDone(msgspec.Struct, frozen=True):
    """The end of a procedure (launch, swap ...)."""

    name: str
    result: Any
    """return value of the procedure; `Done("cancelled")` after a cancellation"""

    @property
    def failure(self) -> str | None:
        """None after a success."""
        return self.result.failure if isinstance(self.result, Done) else None


SessionEvent = (
    FirstHeartbeat
    | StateChanged
    | VehicleLost
    | VehicleRestored
    | VehicleRebooted
    | StatusText
    | ProcedureDone
)
