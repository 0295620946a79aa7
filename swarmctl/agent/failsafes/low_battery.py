"""Low battery: return while the charge suffices, and land before the battery is empty.

| charge | demand |
|---|---|
| below `return_percent` | return; may wait for a clear path |
| below `return_percent` − `wait_percent` | return without waiting |
| below `land_percent` | landing |
"""

from __future__ import annotations

import msgspec
from pydantic import Field

from swarmctl.agent.failsafes.base import STRENGTH, Demand, DemandKind, FailsafeFacts, has_lasted, true_since
from swarmctl.core.records import replace
from swarmctl.core.section import Section

NAME = "low_battery"
DESCRIPTION = "Low battery: the vehicle returns, or lands at its position."


class Params(Section):
    """Limits of the remaining charge, as the vehicle reports it."""

    return_percent: float = Field(
        25.0, ge=0.0, le=100.0, description="charge below which the vehicle returns [%]; 0: never"
    )
    land_percent: float = Field(
        10.0, ge=0.0, le=100.0, description="charge below which the vehicle lands where it is [%]; 0: never"
    )
    wait_percent: float = Field(
        5.0,
        ge=0.0,
        le=100.0,
        description="charge below `return_percent` that the vehicle may spend in hold, until its return path "
        "is clear [%]; 0: no wait",
    )
    seconds: float = Field(
        3.0,
        ge=0.0,
        description="time below a limit until the rule acts [s], because full thrust makes the voltage sag",
    )

    def model_post_init(self, _context: object) -> None:
        if self.return_percent and self.land_percent > self.return_percent:
            raise ValueError(
                f"land_percent {self.land_percent:g} is above return_percent {self.return_percent:g}, so the "
                "vehicle would land before it could return; lower land_percent"
            )


class LowBatteryMemory(msgspec.Struct, frozen=True):
    return_since_s: float | None = None
    land_since_s: float | None = None
    demanded: Demand | None = None
    """demand kept for the rest of the flight, because a recovered voltage is no recovered charge"""


def evaluate(
    params: Params, memory: LowBatteryMemory | None, facts: FailsafeFacts, _now: float
) -> tuple[LowBatteryMemory, Demand | None]:
    memory = memory or LowBatteryMemory()
    percent, status_s = facts.vehicle.battery_percent, facts.vehicle.status_s
    if not facts.in_flight:
        return LowBatteryMemory(), None
    if percent is None or status_s is None or facts.lost:
        return LowBatteryMemory(demanded=memory.demanded), memory.demanded
    # These durations grow only with each new SYS_STATUS.
    return_since_s = true_since(memory.return_since_s, percent < params.return_percent, status_s)
    land_since_s = true_since(memory.land_since_s, percent < params.land_percent, status_s)
    demanded = memory.demanded
    if has_lasted(land_since_s, params.seconds, status_s):
        demanded = _stronger(demanded, DemandKind.LAND, percent, params.land_percent)
    elif has_lasted(return_since_s, params.seconds, status_s):
        demanded = _stronger(demanded, DemandKind.RETURN, percent, params.return_percent)
        demanded = replace(demanded, urgent=demanded.urgent or percent < _least_waiting_percent(params))
    return LowBatteryMemory(return_since_s, land_since_s, demanded), demanded


def _least_waiting_percent(params: Params) -> float:
    """Return the least charge with which a return may wait [%]."""
    return max(params.return_percent - params.wait_percent, params.land_percent)


def _stronger(demanded: Demand | None, kind: DemandKind, percent: float, limit: float) -> Demand:
    if demanded is not None and STRENGTH[demanded.kind] >= STRENGTH[kind]:
        return demanded
    reason = f"battery at {percent:g} %, below the limit of {limit:g} % in rules.low_battery"
    return Demand(kind, reason, urgent=kind is DemandKind.LAND)
