"""The events of a vehicle's session, and the vehicle's identity.

State, loss, restoration and reboot are reported as the agent's own events. A new state comes at once with a
position, with a change of mode, arming or `other_mission`, and with the first heartbeat after a loss; with
other telemetry about 1 s after the last state.
"""

from __future__ import annotations

from typing import Any

import msgspec

from swarmctl.core.events import LinkLost, LinkRestored, Rebooted, TelemetryReceived
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
    FirstHeartbeat | TelemetryReceived | LinkLost | LinkRestored | Rebooted | StatusText | ProcedureDone
)
