"""GPS loss: a vehicle without a GPS fix, or without a position in its telemetry.

The autopilot detects the loss first and usually reacts. The agent then releases the vehicle (`taken_over`).
If the autopilot does not react, this rule acts:

| condition | after `seconds` | after `land_s` | after twice `land_s` |
|---|---|---|---|
| no fix | warning | landing: without a position the vehicle can neither hold nor return | |
| no position, and no report of a GPS fix | warning | landing | |
| no position, GPS has a fix | warning | return, which may still work | landing, unless the vehicle returns |
"""

from __future__ import annotations

import msgspec
from pydantic import Field

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts, true_since
from swarmctl.core.section import Section

NAME = "gps_loss"
DESCRIPTION = "Loss of the GPS fix or position: a warning, later a landing or a return."


class Params(Section):
    """Limits for the time without a GPS fix (by SYS_STATUS) or without a position."""

    seconds: float = Field(2.0, ge=0.0, description="time without a fix or a position until the warning [s]")
    land_s: float = Field(
        20.0, gt=0.0, description="time until a landing or return, if the autopilot does not react [s]"
    )


class GpsLossMemory(msgspec.Struct, frozen=True):
    no_fix_since_s: float | None = None
    """time of the first SYS_STATUS without a fix"""
    no_position_since_s: float | None = None
    """time of the first telemetry without a position"""
    landing: Demand | None = None
    """demanded landing; it continues after a new fix, because the fix may be lost again"""


def evaluate(
    params: Params, memory: GpsLossMemory | None, facts: FailsafeFacts, now: float
) -> tuple[GpsLossMemory, Demand | None]:
    memory, vehicle = memory or GpsLossMemory(), facts.vehicle
    if not facts.in_flight:
        return GpsLossMemory(), None
    if facts.lost:
        # The last telemetry is old: all durations restart, and a demanded landing stays.
        return GpsLossMemory(landing=memory.landing), None
    status_s = vehicle.status_s
    no_fix_since_s = (
        None if status_s is None else true_since(memory.no_fix_since_s, vehicle.gps_ok is False, status_s)
    )
    # This duration grows only with each new SYS_STATUS.
    no_fix_s = None if no_fix_since_s is None or status_s is None else status_s - no_fix_since_s
    no_position_since_s = true_since(memory.no_position_since_s, not vehicle.has_position, now)
    no_position_s = None if no_position_since_s is None else now - no_position_since_s
    demand = memory.landing or _demand(params, facts, no_fix_s, no_position_s)
    landing = demand if demand is not None and demand.kind is DemandKind.LAND else None
    return GpsLossMemory(no_fix_since_s, no_position_since_s, landing), demand


def _demand(
    params: Params, facts: FailsafeFacts, no_fix_s: float | None, no_position_s: float | None
) -> Demand | None:
    """Return the demand after `no_fix_s` without a fix and `no_position_s` without a position.

    A duration is None while the vehicle has a fix, or a position.
    """
    if no_fix_s is not None and no_fix_s >= params.land_s:
        return Demand(
            DemandKind.LAND, f"no GPS fix for {params.land_s:g} s, and the autopilot does not react"
        )
    if no_position_s is not None and no_position_s >= params.land_s:
        return _return_or_landing(params, facts, no_position_s)
    if no_fix_s is not None and no_fix_s >= params.seconds:
        text, order = "no GPS fix", "a landing"
    elif no_position_s is not None and no_position_s >= params.seconds:
        text, order = "telemetry without a position", "a return or a landing"
    else:
        return None
    wait = f"if this lasts {params.land_s:g} s and the autopilot does not react, this program orders {order}"
    return Demand(DemandKind.WARN, f"{text} for {params.seconds:g} s; {wait}")


def _return_or_landing(params: Params, facts: FailsafeFacts, no_position_s: float) -> Demand:
    text = f"telemetry without a position for {params.land_s:g} s"
    if facts.vehicle.gps_ok is not True:
        return Demand(DemandKind.LAND, f"{text}, and the autopilot does not react")
    if no_position_s >= 2.0 * params.land_s and facts.vehicle.mode_role != "return":
        text = f"telemetry without a position for {2.0 * params.land_s:g} s"
        return Demand(DemandKind.LAND, f"{text}, and the vehicle does not return")
    return Demand(DemandKind.RETURN, f"{text}, although the GPS has a fix")
